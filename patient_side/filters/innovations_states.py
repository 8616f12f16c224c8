"""The states of an innovations model as its filter holds them: transition, noise, level and start.

The state is ``s = [x (n), e (3), y (3)]`` in source time: the model's states, the innovation, and the position
itself. With the level ``b[k] = y[k] - C x[k] - e[k]``, whose step is d, the model is

    x[k+1] = A x[k] + K e[k],   y[k+1] = y[k] + C (A - I) x[k] + (C K - I) e[k] + d[k] + e[k+1]

The level itself is no state. It would be as large as the position, and the innovation, a millionth of it in a quiet
movement, a difference of large numbers: K times its rounding error was observed to exceed the covariances.

An integrated model has no level; with x the prediction for the next increment its state is ``s = [x (n), y (3)]``:

    x[k+1] = A x[k] + K e[k+1],   y[k+1] = y[k] + C x[k] + e[k+1]

In both cases s has a plain transition with white noise, whichever samples arrive: the cross covariance of process and
measurement noise, inherent in an innovations form, is part of the transition. A sample of the arm is y without error;
a command that stands in for it, through the gain, has the error of that relation.

Oracle: the textbook filter with the cross term, test_innovations_filter.
"""

import numpy as np

from tis.patient_side.movement_models import InnovationsModel
from tis.patient_side.statespace import Array

_MAX_DOUBLINGS = 40


def transition(model: InnovationsModel) -> Array:
    """Return the transition (M, M) of s over one sample."""
    n, axes = model.order, len(model.C)
    eye = np.eye(axes)
    if model.integrated:
        return np.block([[model.A, np.zeros((n, axes))], [model.C, eye]])
    onward = np.hstack([model.A, model.K])
    moved = model.C @ onward - np.hstack([model.C, eye])
    none = np.zeros((n + axes, axes))
    return np.block([[np.vstack([onward, np.zeros((axes, n + axes))]), none], [moved, eye]])


def level(model: InnovationsModel) -> Array:
    """Return the map (d, M) from a state to its level."""
    eye = np.eye(len(model.C))
    return np.hstack([-model.C, -eye, eye])


def noise(model: InnovationsModel) -> Array:
    """Return the covariance (M, M) of the white noise that enters s in one sample."""
    n, axes = model.order, len(model.C)
    if model.integrated:
        enters = np.vstack([model.K, np.eye(axes)])
        return np.asarray(enters @ model.Re @ enters.T)
    noise = np.zeros((n + 2 * axes, n + 2 * axes))
    noise[n:, n:] = np.tile(model.Re, (2, 2))
    noise[n + axes :, n + axes :] += model.level_step**2 * model.Re
    return noise


def start_covariance(model: InnovationsModel) -> Array:
    """Return the covariance of s after one sample: stationary x, e with its own covariance, certain y."""
    n, axes = model.order, len(model.C)
    states, power = model.K @ model.Re @ model.K.T, model.A
    # The stationary covariance, by doubling: each pass covers twice as many samples, and A is stable.
    for _ in range(_MAX_DOUBLINGS):
        states = states + power @ states @ power.T
        power = power @ power
    size = len(transition(model))
    covariance = np.zeros((size, size))
    covariance[:n, :n] = (states + states.T) / 2
    if not model.integrated:
        covariance[n : n + axes, n : n + axes] = model.Re
    return covariance
