"""Further states of the filter: the recent past (increments, running means), and an arm that follows its command.

Those of the past follow the position exactly, without noise of their own: with the position y and a mean's share q of
a sample,

    i_0[k+1] = y[k+1] - y[k],   i_j[k+1] = i_{j-1}[k],   u[k+1] = q (u[k] + y[k+1] - y[k]),   u = y - mean

As states of the filter they need no samples of their own. Where one is missing, the filter forecasts it, and the next
sample corrects the forecast: the filter's covariances make it a smoother of the path between the two.
"""

from math import exp
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import MEANS_S, N_INCREMENTS, ArmResponse

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


# An arm that follows its command, as states of the filter after those of the command's movement.
#
# An arm that lags says nothing of where it will be that its command does not say sooner: up to the lag nothing has to
# be foretold. The response is a regression of the arm's increments, `ArmResponse`, on the command's increments, which
# the filter holds as the `recent_past`, on the one to come, and on the arm's own last ones. All of these states are
# certain once samples of both have arrived, so the response needs no level, no operating point and no noise of its
# own but that of the arm's next increment.
#
# An arm with a pull also has the way z that it has yet to go. It is a state rather than the offset between command
# and arm: it is small, and as uncertain whichever of the two positions has been seen.
#
# The states are ``[the command's past and movement, dy[k], .., dy[k-3], z[k], p[k], y[k]]``: the two positions that
# samples show come last.

WAY_UNKNOWN: Final = 1e3
"""Variance of the way that an arm has yet to go before it has been seen to go, in units of the innovations'."""


def following(response: ArmResponse, step: Array, noise: Array, unit: Array) -> tuple[Array, Array, NDArray[np.intp]]:
    """Return transition and noise (M, M) of command and arm, and the places of the command's states among theirs.

    ``step`` and ``noise`` are the command's: its last increments are the first states, its position p the last.
    ``unit`` (d, d) is the covariance of its innovations. Oracle in test_arm_response: the regression, row by row.
    """
    d = len(unit)
    eye, n, n_lags, n_way = np.eye(d), len(step), N_INCREMENTS * d, d if response.pull else 0
    size = n + n_lags + n_way + d
    lags, p, y = slice(n - d, n - d + n_lags), slice(size - 2 * d, size - d), slice(size - d, size)
    way = slice(lags.stop, lags.stop + n_way)
    place = np.concatenate([np.arange(n - d), np.arange(p.start, p.stop)])
    whole = np.zeros((size, size))
    whole[np.ix_(place, place)] = step
    # The arm's next increment: by the command's next one, the command's last ones, and its own.
    moved = response.command[0] * whole[p]
    moved[:, p] -= response.command[0] * eye
    moved[:, :n_lags] += np.kron(response.command[1:], eye)
    moved[:, lags] += np.kron(response.own, eye)
    moved[:, way] += response.pull * eye[:, :n_way]
    whole[lags] = np.eye(n_lags, size, k=lags.start - d)
    whole[lags.start : lags.start + d] = moved
    whole[y] = moved
    whole[y, y] += eye
    # It has a share of the command's innovation, and one of its own.
    enters = np.zeros((size, n + d))
    enters[place, np.arange(n)] = 1.0
    for each in (slice(lags.start, lags.start + d), y):
        enters[each, n - d : n] = response.command[0] * eye
        enters[each, n:] = eye
    joint = np.zeros((n + d, n + d))
    joint[:n, :n], joint[n:, n:] = noise, response.noise * unit
    spread = enters @ joint @ enters.T
    if n_way:
        # The way grows as the command moves, and shrinks as the arm does.
        goes = np.eye(size)[p] - np.eye(size)[y]
        whole[way] = goes @ whole - goes
        whole[way, way] += eye
        entered = goes @ enters
        spread[way], spread[:, way] = entered @ joint @ enters.T, enters @ joint @ entered.T
        spread[way, way] = entered @ joint @ entered.T + response.drift * response.noise * unit
    return whole, spread, place
