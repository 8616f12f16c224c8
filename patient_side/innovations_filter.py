"""The Kalman filter of an innovations model: its matrices, worked out once, and its steps.

The state is ``s = [x (n), b (3), y (3)]`` in source time: the model's states, the level, and the position itself.
With ``e[k] = y[k] - C x[k] - b[k]`` the model is

    x[k+1] = A x[k] + K e[k],   b[k+1] = b[k] + d[k],   y[k+1] = C x[k+1] + b[k+1] + e[k+1]

An integrated model has no level; with x the prediction for the next increment its state is ``s = [x (n), y (3)]``:

    x[k+1] = A x[k] + K e[k+1],   y[k+1] = y[k] + C x[k] + e[k+1]

Either way s has a plain transition with white noise, whichever of its samples arrive: the cross covariance of process
and measurement noise that an innovations form brings with it is in the transition. A sample of the arm is y without
error; one of its command through the gain has the error of that relation.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dposv

from patient_side.statespace import Array, InnovationsModel

AXES = 3

_MOST_DOUBLINGS = 40


class Gain(NamedTuple):
    """Weights (3, N) of the innovation, what its square is expected to be, and the covariance (N, N) left."""

    weights: Array
    variance: float
    covariance: Array


class Updated(NamedTuple):
    """Mean (N,), covariance (N, N), and the innovation's square over its expectation: 1 on average."""

    mean: Array
    covariance: Array
    surprise: float


@dataclass(frozen=True, eq=False)
class InnovationsFilter:
    """Matrices for N states and steps of 0 .. H + 1 samples; of the N the last 3 are y, those of ``level`` are b.

    ``one_step`` (N, N) is the transition from sample to sample; ``transitions`` and ``noises`` (H + 2, N, N) are
    those of g steps at once; ``outputs`` (H + 2, 3, N) the rows of the transitions that give y. ``noise_now`` (H + 2,
    3, 3) is the noise's share in the covariance of y[h], and ``noise_across`` in that of y[h] with y[h + 1], plus its
    transpose. ``start_covariance`` (N, N) is that after a first sample, nothing being known of the level before.
    """

    level: slice | None
    one_step: Array
    transitions: Array
    noises: Array
    outputs: Array
    noise_now: Array
    noise_across: Array
    start_covariance: Array

    @property
    def horizon(self) -> int:
        """Return H, the number of samples beyond which nothing is forecast."""
        return len(self.transitions) - 2

    def start(self, sample: Array, error: Array | None = None) -> tuple[Array, Array]:
        """Return mean (N,) and covariance (N, N) after a first sample (3,), of covariance ``error`` (3, 3) if any.

        The model's states are as they are at any time, the level is what the sample leaves for it.
        """
        mean, covariance = np.zeros(len(self.start_covariance)), self.start_covariance
        mean[-AXES:] = sample
        if self.level is not None:
            mean[self.level] = sample
        if error is not None:
            covariance = covariance.copy()
            first = -AXES if self.level is None else -2 * AXES
            covariance[first:, first:] += np.tile(error, (-first // AXES, -first // AXES))
        return mean, covariance

    def gain(self, covariance: Array, gap: int, error: Array | None = None) -> Gain:
        """Return what a sample (3,) ``gap`` samples later (1 .. horizon) does, before it is known."""
        step = self.transitions[gap]
        covariance = step.dot(covariance).dot(step.T)
        covariance += self.noises[gap]
        rows = covariance[-AXES:]
        expected = rows[:, -AXES:] if error is None else rows[:, -AXES:] + error
        _, weights, _ = dposv(expected, rows)
        variance = float(expected.trace())
        covariance -= rows.T.dot(weights)
        left = covariance + covariance.T  # rounding, which else grows over gaps
        left *= 0.5
        return Gain(weights, variance, left)

    def update(self, mean: Array, covariance: Array, gap: int, sample: Array, error: Array | None = None) -> Updated:
        """Return mean and covariance ``gap`` samples later (1 .. horizon), given the sample (3,) there.

        Oracles: one-shot conditioning of the joint Gaussian, and a textbook filter with the cross term.
        """
        gained = self.gain(covariance, gap, error)
        mean = self.transitions[gap].dot(mean)
        innovation = sample - mean[-AXES:]
        mean += innovation.dot(gained.weights)
        return Updated(mean, gained.covariance, float(innovation.dot(innovation)) / gained.variance)

    def weights(self, steps: int, fraction: float) -> Array:
        """Return what (3, N) gives the position ``steps + fraction`` samples later; ``steps`` <= horizon.

        Truth is linear between sample instants. Oracle: a dense interpolation of the forecasts of whole samples.
        """
        return np.asarray((1.0 - fraction) * self.outputs[steps] + fraction * self.outputs[steps + 1])

    def noise(self, steps: int, fraction: float) -> Array:
        """Return the share of noise (3, 3) in the covariance of that forecast."""
        here = 1.0 - fraction
        noise = (here * here) * self.noise_now[steps]
        noise += (fraction * fraction) * self.noise_now[steps + 1]
        noise += (here * fraction) * self.noise_across[steps]
        return np.asarray(noise)

    def spread(self, covariance: Array, steps: int, fraction: float) -> Array:
        """Return the covariance (3, 3) of that forecast. Oracle: one-shot conditioning of the joint Gaussian."""
        weights = self.weights(steps, fraction)
        return np.asarray(self.noise(steps, fraction) + weights.dot(covariance).dot(weights.T))


def build_innovations_filter(model: InnovationsModel, horizon: int) -> InnovationsFilter:
    """Return the filter of a model; nothing is forecast over more than ``horizon`` (>= 1) samples."""
    step, noise = _transition(model), _noise(model)
    size = len(step)
    transitions, noises = np.empty((horizon + 2, size, size)), np.zeros((horizon + 2, size, size))
    transitions[0] = np.eye(size)
    for h in range(1, horizon + 2):
        transitions[h] = step @ transitions[h - 1]
        noises[h] = step @ noises[h - 1] @ step.T + noise
        noises[h] = (noises[h] + noises[h].T) / 2
    across = noises[:, -AXES:] @ step[-AXES:].T
    return InnovationsFilter(
        level=None if model.integrated else slice(model.order, model.order + AXES),
        one_step=step,
        transitions=transitions,
        noises=noises,
        outputs=transitions[:, -AXES:].copy(),
        noise_now=noises[:, -AXES:, -AXES:].copy(),
        noise_across=across + across.transpose(0, 2, 1),
        start_covariance=_start_covariance(model),
    )


def _transition(model: InnovationsModel) -> Array:
    n, eye = model.order, np.eye(AXES)
    if model.integrated:
        return np.block([[model.A, np.zeros((n, AXES))], [model.C, eye]])
    step = np.zeros((n + 2 * AXES, n + 2 * AXES))
    step[:n] = np.hstack([model.A - model.K @ model.C, -model.K, model.K])
    step[n : n + AXES, n : n + AXES] = eye
    step[n + AXES :] = model.C @ step[:n] + step[n : n + AXES]
    return step


def _noise(model: InnovationsModel) -> Array:
    n = model.order
    if model.integrated:
        enters = np.vstack([model.K, np.eye(AXES)])
        return np.asarray(enters @ model.Re @ enters.T)
    noise = np.zeros((n + 2 * AXES, n + 2 * AXES))
    noise[n:, n:] = np.tile(model.level_step**2 * model.Re, (2, 2))
    noise[n + AXES :, n + AXES :] += model.Re
    return noise


def _start_covariance(model: InnovationsModel) -> Array:
    """Return the covariance of s after one sample: x stationary, y certain, and ``b = y - C x - e``."""
    n = model.order
    states, power = model.K @ model.Re @ model.K.T, model.A
    for _ in range(_MOST_DOUBLINGS):  # twice as many samples each time: A is stable
        states = states + power @ states @ power.T
        power = power @ power
    if model.integrated:
        covariance = np.zeros((n + AXES, n + AXES))
        covariance[:n, :n] = (states + states.T) / 2
        return covariance
    level = slice(n, n + AXES)
    covariance = np.zeros((n + 2 * AXES, n + 2 * AXES))
    covariance[:n, :n] = (states + states.T) / 2
    covariance[:n, level] = -covariance[:n, :n] @ model.C.T
    covariance[level, :n] = covariance[:n, level].T
    covariance[level, level] = -model.C @ covariance[:n, level] + model.Re
    return covariance
