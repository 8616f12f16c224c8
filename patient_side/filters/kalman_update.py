"""The Kalman filter's two steps: prediction, and the update by a measurement.

For ``x[k+1] = F x[k] + drive[k] + w[k]``, ``y[k] = H x[k] + v[k]`` with covariances Q of w and R of v:

    prediction   x <- F x + drive,            P <- F P F' + Q
    update       K = P H' (H P H' + R)^-1,    x <- x + K (y - H x),   P <- (I - K H) P (I - K H)' + K R K'

The covariance update is Joseph's form, which holds for any gain and keeps P symmetric and positive semidefinite
where ``(I - K H) P`` loses both by rounding (Bucy and Joseph 1968; Simon, *Optimal State Estimation*, 5.1).
"""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
from filterpy.kalman import KalmanFilter

from tis.patient_side.statespace import Array

# Every Kalman filter of the patient's side computes this update:
# - here, by filterpy, for `moesp_kf`, `n4sid_kf`, `arx_kf` (through `filters.kalman`) and `paper`;
# - `identification.paper_noise` with `joseph_update` and a gain of its own, a pseudo-inverse: far from convergence
#   H P H' + R can be numerically singular;
# - `InnovationsFilter.gain` in another form: its measurement is the last block of the state, without noise, and P may
#   be one Kronecker factor, a third of the size. Rows, a Cholesky solution and BLAS in place replace the products;
# - `paper_kalman.printed_update` as the paper prints it, channel by channel and with ``(I - K C) P``: a reproduction
#   must round, and diverge, as the printed formula does.


class Gaussian(NamedTuple):
    """A normal distribution: mean (n,) and covariance (n, n)."""

    mean: Array
    covariance: Array


@cache
def _filter(n: int, p: int) -> KalmanFilter:
    """Return filterpy's filter for n states and p outputs. Each step loads its state first, so nothing remains."""
    return KalmanFilter(dim_x=n, dim_z=p)


def kalman_predict(x: Array, P: Array, F: Array, Q: Array, drive: Array | None = None) -> Gaussian:
    """Return the state one step later; ``drive`` (n,) is what a known input adds to it."""
    kf = _filter(len(x), 1)
    kf.x, kf.P = x, P
    kf.predict(F=F, Q=Q)
    return Gaussian(kf.x if drive is None else kf.x + drive, kf.P)


def kalman_update(
    x: Array, P: Array, y: Array, H: Array, R: Array, inverse: Callable[..., Array] = np.linalg.inv
) -> Gaussian:
    """Return the state given a measurement ``y`` (p,) with noise covariance ``R`` (p, p): the Kalman update.

    ``inverse`` inverts the innovation's covariance; for p = 1, `numpy.reciprocal` does not raise after divergence.
    Oracle: the conditional of a joint Gaussian, test_kalman_update.
    """
    kf = _filter(len(x), len(H))
    kf.x, kf.P, kf.inv = x, P, inverse
    kf.update(y, R=R, H=H)
    return Gaussian(kf.x, kf.P)


def joseph_update(x: Array, P: Array, y: Array, H: Array, R: Array, K: Array) -> Gaussian:
    """Return the state given a measurement that enters with the gain ``K`` (n, p), optimal or not."""
    rest = np.eye(len(x)) - K.dot(H)
    return Gaussian(x + K.dot(y - H.dot(x)), rest.dot(P).dot(rest.T) + K.dot(R).dot(K.T))
