"""The Kalman filter's two steps: prediction, and the update by a measurement.

For ``x[k+1] = F x[k] + drive[k] + w[k]``, ``y[k] = H x[k] + v[k]`` with covariances Q of w and R of v:

    prediction   x <- F x + drive,            P <- F P F' + Q
    update       K = P H' (H P H' + R)^-1,    x <- x + K (y - H x),   P <- (I - K H) P (I - K H)' + K R K'

The covariance update is Joseph's form, which holds for any gain and keeps P symmetric and positive semidefinite
where ``(I - K H) P`` loses both by rounding (Bucy and Joseph 1968; Simon, *Optimal State Estimation*, 5.1).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from patient_side.statespace import Array

Inverse = Callable[[Array], NDArray[Any]]

# Every Kalman filter of the patient's side computes this update:
# - here, for `moesp_kf`, `n4sid_kf`, `arx_kf` (through `filters.kalman`) and `paper`;
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


def kalman_predict(x: Array, P: Array, F: Array, Q: Array, drive: Array | None = None) -> Gaussian:
    """Return the state one step later; ``drive`` (n,) is what a known input adds to it."""
    mean = F.dot(x)
    return Gaussian(mean if drive is None else mean + drive, F.dot(P).dot(F.T) + Q)


def kalman_gain(P: Array, H: Array, R: Array, inverse: Inverse = np.linalg.inv) -> Array:
    """Return the Kalman gain ``K = P H' (H P H' + R)^-1`` (n, p)."""
    across = P.dot(H.T)
    return np.asarray(across.dot(inverse(H.dot(across) + R)))


def joseph_update(x: Array, P: Array, y: Array, H: Array, R: Array, K: Array) -> Gaussian:
    """Return the state given a measurement that enters with the gain ``K`` (n, p), optimal or not."""
    rest = np.eye(len(x)) - K.dot(H)
    return Gaussian(x + K.dot(y - H.dot(x)), rest.dot(P).dot(rest.T) + K.dot(R).dot(K.T))


def kalman_update(x: Array, P: Array, y: Array, H: Array, R: Array, inverse: Inverse = np.linalg.inv) -> Gaussian:
    """Return the state given a measurement ``y`` (p,) with noise covariance ``R`` (p, p): the Kalman update.

    ``inverse`` inverts the innovation's covariance; for p = 1, `numpy.reciprocal` does not raise after divergence.
    Oracles in test_kalman_update: filterpy's filter, bit for bit, and the conditional of a joint Gaussian.
    """
    return joseph_update(x, P, y, H, R, kalman_gain(P, H, R, inverse))
