"""The Kalman filter of an identified system, sample by sample, where any channel of any sample may be missing.

Given y[k], the noises w and v of the innovations form are correlated. The step to k + 1 therefore takes both at once:
``x <- A x + B u + G (y - C x - D u)`` with ``G = (A P C' + S) (C P C' + R)^-1`` and
``P <- (A - G C) P (A - G C)' + Q - G S' - S G' + G R G'`` (Anderson and Moore, *Optimal Filtering*, 5.4). Rows of
C, D, R and columns of S whose channel is missing are left out; without any, the step is the plain prediction.
"""

from collections import deque

import numpy as np

from tis.patient_side.linear_system import Array, NoiseModel, StateSpace

_UNKNOWN = 1e4
"""Variance of each state before the first sample, where outputs of unit deviation have states of about that size."""


class GapFilter:
    """A filter that is given each sample by `update` and moved to the next one by `predict`.

    Parameters
    ----------
    space, noise
        The system, and its noise in innovations form.
    delay
        Samples by which each input acts late.
    x0
        Mean of the first state (n,); zero, and quite unknown, by default.

    Attributes
    ----------
    x, P
        Mean (n,) and covariance (n, n) of the state of the present sample, given the samples before it.

    Notes
    -----
    Oracle: one-shot conditioning of the joint Gaussian, test_gap_filter.
    """

    def __init__(self, space: StateSpace, noise: NoiseModel, delay: tuple[int, ...] = (), x0: Array | None = None):
        self._space, self._noise = space, noise
        self._delay = delay or (0,) * space.n_inputs
        self._inputs = deque([np.zeros(space.n_inputs)], maxlen=max(self._delay, default=0) + 1)
        self._next: tuple[Array, Array] | None = None
        self.x = np.zeros(space.order) if x0 is None else np.array(x0, dtype=float)
        self.P = _UNKNOWN * np.eye(space.order)

    def update(self, y: Array, u: Array | None = None) -> Array:
        """Take the present sample, y (p,) and u (m,), and return its innovation (p,), NaN where y is NaN.

        A channel of u that is NaN keeps its last value.
        """
        space, noise = self._space, self._noise
        given = np.zeros(space.n_inputs) if u is None else np.asarray(u, dtype=float).reshape(-1)
        self._inputs.append(np.where(np.isnan(given), self._inputs[-1], given))
        acting = self._acting(len(self._inputs) - 1)
        innovation = np.asarray(y, dtype=float).reshape(-1) - space.C @ self.x - space.D @ acting
        seen = np.isfinite(innovation)
        C, R, S = space.C[seen], noise.R[np.ix_(seen, seen)], noise.S[:, seen]
        G = np.linalg.solve(C @ self.P @ C.T + R, (space.A @ self.P @ C.T + S).T).T
        rest = space.A - G @ C
        P = rest @ self.P @ rest.T + noise.Q - G @ S.T - S @ G.T + G @ R @ G.T
        self._next = space.A @ self.x + space.B @ acting + G @ innovation[seen], (P + P.T) / 2
        return np.asarray(innovation)

    def predict(self) -> None:
        """Move to the next sample; without an `update` of the present one, no output and the last input are known."""
        if self._next is None:
            self.update(np.full(self._space.n_outputs, np.nan), np.full(self._space.n_inputs, np.nan))
        assert self._next is not None
        (self.x, self.P), self._next = self._next, None

    def forecast(self, steps: int, u: Array | None = None) -> tuple[Array, Array]:
        """Return mean (steps, p) and covariance (steps, p, p) of the present output and those after it.

        ``u`` (steps, m) are their inputs; by default each keeps its last value. The filter itself does not move.
        """
        ahead = GapFilter(self._space, self._noise, self._delay, self.x)
        ahead.P, ahead._inputs = self.P, self._inputs.copy()
        p, unknown = self._space.n_outputs, np.full(self._space.n_outputs, np.nan)
        mean, covariance = np.empty((steps, p)), np.empty((steps, p, p))
        for k in range(steps):
            state, P = ahead.x, ahead.P
            ahead.update(unknown, np.full(self._space.n_inputs, np.nan) if u is None else u[k])
            mean[k] = self._space.C @ state + self._space.D @ ahead._acting(len(ahead._inputs) - 1)
            covariance[k] = self._space.C @ P @ self._space.C.T + self._noise.R
            ahead.predict()
        return mean, covariance

    def _acting(self, newest: int) -> Array:
        """Return each input as it acts now; before the first sample all are zero."""
        late = [(newest - d, i) for i, d in enumerate(self._delay)]
        return np.array([self._inputs[k][i] if k >= 0 else 0.0 for k, i in late])
