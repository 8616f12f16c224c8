"""The innovations form of a stochastic model: its Kalman gain, from a discrete algebraic Riccati equation.

For ``x[k+1] = A x[k] + w[k]``, ``y[k] = C x[k] + v[k]`` with the joint covariance [Q S; S' R] of w and v, the
stationary one-step predictor has innovations e of covariance Re and the gain K:

    P = A P A' + Q - K Re K',   Re = C P C' + R,   K = (A P C' + S) Re^-1

and ``x[k+1] = A x[k] + K e[k]``, ``y[k] = C x[k] + e[k]`` has the same second moments (Anderson and Moore, *Optimal
Filtering*, 9.3). The cross term S must not be dropped.
"""

from dataclasses import dataclass

import numpy as np

from tis.patient_side.statespace import Array

_MAX_DOUBLINGS = 60
_CONVERGED = 1e-15


@dataclass(frozen=True)
class InnovationsForm:
    """``x[k+1] = A x[k] + K e[k]``, ``y[k] = C x[k] + e[k]`` with the covariance ``Re`` of e."""

    A: Array
    C: Array
    K: Array
    Re: Array

    def in_units(self, scale: Array) -> "InnovationsForm":
        """Return the same model of outputs multiplied by ``scale`` (p,)."""
        out = scale[:, None]
        return InnovationsForm(self.A, out * self.C, self.K / scale, out * self.Re * scale)


def innovations_form(A: Array, C: Array, Q: Array, R: Array, S: Array) -> InnovationsForm:
    """Return the innovations form for noises of covariances Q (n, n), R (p, p) > 0 and cross term S (n, p).

    A - K C is stable where A is. Oracles in test_innovations_form: scipy's solver on the eigenvalues of a pencil, and
    Kalman's recursion.
    """
    P = filter_riccati(A, C, Q, R, S)
    Re = C @ P @ C.T + R
    Re = (Re + Re.T) / 2
    K = np.linalg.solve(Re, (A @ P @ C.T + S).T).T
    return InnovationsForm(A, C, np.asarray(K), Re)


def filter_riccati(A: Array, C: Array, Q: Array, R: Array, S: Array) -> Array:
    """Return the stabilising solution P (n, n) of the filter's Riccati equation, cross term included.

    Given y, the noise of the transition ``A - T C``, ``T = S R^-1``, is ``Q - T S'`` and independent of v; the
    remaining equation is solved by doubling: every step covers twice as many samples (Anderson 1978, Int. J. Control
    28:295). Unlike methods on eigenvalues it stays accurate with modes close to the unit circle.
    """
    n = len(A)
    T = np.linalg.solve(R, S.T).T
    a, h = (A - T @ C).T, Q - T @ S.T
    g = C.T @ np.linalg.solve(R, C)
    h = (h + h.T) / 2
    for _ in range(_MAX_DOUBLINGS):
        through = np.linalg.solve(np.eye(n) + g @ h, np.hstack([a, g]))
        step = a.T @ h @ through[:, :n]
        g = g + a @ through[:, n:] @ a.T
        a = a @ through[:, :n]
        h = h + step
        g, h = (g + g.T) / 2, (h + h.T) / 2
        if np.max(np.abs(step), initial=0.0) <= _CONVERGED * np.max(np.abs(h), initial=0.0):
            break
    return np.asarray(h)
