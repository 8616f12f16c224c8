"""The recent past as states of the filter: the last increments, and the ways to running means of the position.

They follow the position exactly, without noise of their own: with the position y and a mean's share q of a sample,

    i_0[k+1] = y[k+1] - y[k],   i_j[k+1] = i_{j-1}[k],   u[k+1] = q (u[k] + y[k+1] - y[k]),   u = y - mean

As states of the filter they need no samples of their own. Where one is missing, the filter forecasts it, and the next
sample corrects the forecast: the filter's covariances make it a smoother of the path between the two.
"""

from math import exp
from typing import NamedTuple

import numpy as np

from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import MEANS_S, N_INCREMENTS

SLOW_MEANS = 3
"""Number of the last of them, which are levels that a hand may return to."""


class RecentPast(NamedTuple):
    """The shares (L,) of the way to each running mean that remain after a sample, at one rate."""

    shares: tuple[float, ...]

    @classmethod
    def at_rate(cls, rate_hz: int) -> "RecentPast":
        """Return the past with the time constants `MEANS_S`."""
        return cls(tuple(exp(-1.0 / (rate_hz * mean_s)) for mean_s in MEANS_S))

    @property
    def n_states(self) -> int:
        """Number of states per axis."""
        return N_INCREMENTS + len(self.shares)

    def before(self, step: Array, noise: Array, axes: int) -> tuple[Array, Array]:
        """Return transition and noise (M, M) with the past's states before those of ``step`` and ``noise``.

        The position is the last of the states. Oracle in test_recent_past: increments and running means of a path.
        """
        eye, n, size = np.eye(axes), axes * self.n_states, len(step)
        moved = step[-axes:].copy()
        moved[:, -axes:] -= eye
        # The share of the position's increment in each state, and what a state takes over from others.
        taken = np.array([1.0] + [0.0] * (N_INCREMENTS - 1) + list(self.shares))
        kept = np.diag([0.0] * N_INCREMENTS + list(self.shares))
        kept[range(1, N_INCREMENTS), range(N_INCREMENTS - 1)] = 1.0
        whole = np.block([[np.kron(kept, eye), np.kron(taken[:, None], moved)], [np.zeros((size, n)), step]])
        enters = np.vstack([np.zeros((n, size)), np.eye(size)])
        enters[:n, -axes:] = np.kron(taken[:, None], eye)
        return whole, np.asarray(enters @ noise @ enters.T)
