"""An arm that follows its command, as states of the filter after those of the command's movement.

An arm that lags says nothing of where it will be that its command does not say sooner: up to the lag nothing has to
be foretold. The response is a regression of the arm's increments, `ArmResponse`, on the command's increments, which
the filter holds as the `recent_past`, on the one to come, and on the arm's own last ones. All of these states are
certain once samples of both have arrived, so the response needs no level, no operating point and no noise of its own
but that of the arm's next increment.

The states are ``[the command's past and movement, dy[k], .., dy[k-3], p[k], y[k]]``: the two positions that samples
show come last.
"""

import numpy as np
from numpy.typing import NDArray

from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import N_INCREMENTS, ArmResponse


def following(response: ArmResponse, step: Array, noise: Array, unit: Array) -> tuple[Array, Array, NDArray[np.intp]]:
    """Return transition and noise (M, M) of command and arm, and the places of the command's states among theirs.

    ``step`` and ``noise`` are the command's: its last increments are the first states, its position p the last.
    ``unit`` (d, d) is the covariance of its innovations. Oracle in test_arm_response: the regression, row by row.
    """
    d = len(unit)
    eye, n, n_lags = np.eye(d), len(step), N_INCREMENTS * d
    size = n + n_lags + d
    lags, p, y = slice(n - d, n - d + n_lags), slice(size - 2 * d, size - d), slice(size - d, size)
    place = np.concatenate([np.arange(n - d), np.arange(p.start, p.stop)])
    whole = np.zeros((size, size))
    whole[np.ix_(place, place)] = step
    # The arm's next increment: by the command's next one, the command's last ones, and its own.
    moved = response.command[0] * whole[p]
    moved[:, p] -= response.command[0] * eye
    moved[:, :n_lags] += np.kron(response.command[1:], eye)
    moved[:, lags] += np.kron(response.own, eye)
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
    return whole, enters @ joint @ enters.T, place
