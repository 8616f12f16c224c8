"""The Kalman filter of an innovations model: its matrices, worked out once, and its steps.

The state is ``s = [x (n), e (3), y (3)]`` in source time: the model's states, the innovation, and the position
itself. With the level ``b[k] = y[k] - C x[k] - e[k]``, whose step is d, the model is

    x[k+1] = A x[k] + K e[k],   y[k+1] = y[k] + C (A - I) x[k] + (C K - I) e[k] + d[k] + e[k+1]

The level itself is no state. It would be as large as the position, and the innovation, which a quiet movement has a
millionth of, a difference of large numbers: K times its rounding was seen to outgrow the covariances.

An integrated model has no level; with x the prediction for the next increment its state is ``s = [x (n), y (3)]``:

    x[k+1] = A x[k] + K e[k+1],   y[k+1] = y[k] + C x[k] + e[k+1]

Either way s has a plain transition with white noise, whichever of its samples arrive: the cross covariance of process
and measurement noise that an innovations form brings with it is in the transition. A sample of the arm is y without
error; one of its command through the gain has the error of that relation.

Where every axis moves by states of its own, alike (``A x I``, ``C x I`` and ``K x I`` in Kronecker's sense), the
covariance of s is ``P x Re``, whichever samples arrive, P being that of one axis with innovations of variance 1: then
P, a third of the size, is all that is worked out.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.linalg.blas import dgemm, dsymm
from scipy.linalg.lapack import dposv

from patient_side.statespace import Array, InnovationsModel

AXES = 3

_EYE = np.eye(AXES)
_EYE_ROW = _EYE.reshape(1, AXES * AXES)
_MOST_DOUBLINGS = 40


Gain = tuple[Array, float, Array]
"""Weights (N, 3) of the innovation, what its square is expected to be, and the covariance (M, M) left."""


def square_of(innovation: Array) -> float:
    """Return the square of an innovation (3,): of so few numbers Python's own arithmetic is the quicker."""
    x, y, z = innovation.tolist()
    return float(x * x + y * y + z * z)


class Updated(NamedTuple):
    """Mean (N,), covariance (M, M), and the innovation's square over its expectation: 1 on average."""

    mean: Array
    covariance: Array
    surprise: float


@dataclass(frozen=True, eq=False)
class InnovationsFilter:
    """Matrices for N states and steps of 0 .. H + 1 samples; of the N the last 3 are y.

    ``level`` (3, N) gives the level b, ``level_of_axis`` (M,) that of the first axis in the states of covariances.

    ``horizon`` is H, the number of samples beyond which nothing is forecast. ``transitions``, H + 2 of (N, N),
    are those of g steps at once, ``one_step`` the first, and ``outputs`` (H + 2, 3, N) their rows that give y.

    Covariances (M, M) are of all states, ``n_axes`` = 3 and M = N, or of those of one axis, ``n_axes`` = 1 and
    M = N/3: then the whole is Kronecker's product with ``unit`` (3, 3), the innovations' covariance, whose trace is
    ``unit_trace``; else ``unit`` is 1. ``spreading`` (H + 2, M, M) are the transitions of these, ``noises``, as
    large, what g steps add; ``steps`` holds both once more, transposed: in Fortran's order, as BLAS wants them.
    ``start_covariance`` (M, M) is that after a first sample, nothing being known of the level before. ``noise_now``
    (H + 2, d, d), d axes, is the noise's share in the covariance of y[h], and ``noise_across`` in that of y[h] with
    y[h + 1], plus its transpose.
    """

    level: Array | None
    level_of_axis: Array | None
    horizon: int
    one_step: Array
    transitions: tuple[Array, ...]
    outputs: Array
    n_axes: int
    unit: Array
    spreading: Array
    noises: Array
    noise_now: Array
    noise_across: Array
    start_covariance: Array
    unit_trace: float
    steps: tuple[tuple[Array, Array], ...]

    def start(self, sample: Array, error: Array | None = None) -> tuple[Array, Array]:
        """Return mean (N,) and covariance (M, M) after a first sample (3,), of covariance ``error`` (3, 3) if any.

        The model's states are as they are at any time, the level is what the sample leaves for it. Errors are for
        filters whose covariances are of all axes.
        """
        mean, covariance = np.zeros(len(self.one_step)), self.start_covariance
        mean[-AXES:] = sample
        if error is not None:
            covariance = covariance.copy(order="F")
            covariance[-AXES:, -AXES:] += error
        return mean, covariance

    def gain(self, covariance: Array, gap: int, error: Array | None = None) -> Gain:
        """Return what a sample (3,) ``gap`` samples later (1 .. horizon) does, before it is known.

        Of the covariance only the upper triangle is read, so that rounding, which else grows over gaps, does not make
        it less symmetric from sample to sample. Errors are for filters whose covariances are of all axes.
        """
        step, noise = self.steps[gap]
        covariance = dgemm(1.0, step, dsymm(1.0, covariance, step), 1.0, noise, 1)
        if self.n_axes == 1:
            expected_square = covariance.item(-1)
            column = covariance[:, -1:] / expected_square
            left = dgemm(-expected_square, column, column, 1.0, covariance, 0, 1, 1)
            return column.dot(_EYE_ROW).reshape(-1, AXES), expected_square * self.unit_trace, left
        columns = covariance[:, -AXES:].copy("F")  # what is subtracted from must not be what is multiplied
        expected = columns[-AXES:] if error is None else columns[-AXES:] + error
        _, rows, _ = dposv(expected, columns.T)
        left = dgemm(-1.0, columns, rows, 1.0, covariance, 0, 0, 1)
        square = expected.item
        return rows.T, square(0) + square(4) + square(8), left

    def update(self, mean: Array, covariance: Array, gap: int, sample: Array, error: Array | None = None) -> Updated:
        """Return mean and covariance ``gap`` samples later (1 .. horizon), given the sample (3,) there.

        Oracles: one-shot conditioning of the joint Gaussian, and a textbook filter with the cross term.
        """
        weights, variance, left = self.gain(covariance, gap, error)
        mean = self.transitions[gap].dot(mean)
        innovation = sample - mean[-AXES:]
        mean += weights.dot(innovation)
        return Updated(mean, left, square_of(innovation) / variance)

    def weights(self, steps: int, fraction: float) -> Array:
        """Return what (3, N) gives the position ``steps + fraction`` samples later; ``steps`` <= horizon.

        Truth is linear between sample instants. Oracle: a dense interpolation of the forecasts of whole samples.
        """
        return np.asarray((1.0 - fraction) * self.outputs[steps] + fraction * self.outputs[steps + 1])

    def spread_weights(self, steps: int, fraction: float) -> Array:
        """Return the same (d, M) for covariances."""
        here, there = self.spreading[steps, -self.n_axes :], self.spreading[steps + 1, -self.n_axes :]
        return np.asarray((1.0 - fraction) * here + fraction * there)

    def noise(self, steps: int, fraction: float) -> Array:
        """Return the share of noise (d, d), in units of ``unit``, in the covariance of that forecast."""
        here = 1.0 - fraction
        noise = (here * here) * self.noise_now[steps]
        noise += (fraction * fraction) * self.noise_now[steps + 1]
        noise += (here * fraction) * self.noise_across[steps]
        return np.asarray(noise)

    def spread(self, covariance: Array, steps: int, fraction: float) -> Array:
        """Return the covariance (3, 3) of that forecast. Oracle: one-shot conditioning of the joint Gaussian."""
        weights = self.spread_weights(steps, fraction)
        return np.asarray((self.noise(steps, fraction) + weights.dot(covariance).dot(weights.T)) * self.unit)


def build_innovations_filter(model: InnovationsModel, horizon: int, *, whole: bool = False) -> InnovationsFilter:
    """Return the filter of a model; nothing is forecast over more than ``horizon`` (>= 1) samples.

    ``whole``: with covariances of all axes even where those of one do, as samples with errors of their own need it.
    """
    alike = None if whole else _of_one_axis(model)
    unit = np.ones((1, 1)) if alike is None else model.Re
    if alike is not None:
        model = alike
    step, noise, axes = _transition(model), _noise(model), len(model.C)
    size = len(step)
    spreading, noises = np.empty((horizon + 2, size, size)), np.zeros((horizon + 2, size, size))
    spreading[0] = np.eye(size)
    for h in range(1, horizon + 2):
        spreading[h] = step @ spreading[h - 1]
        noises[h] = step @ noises[h - 1] @ step.T + noise
        noises[h] = (noises[h] + noises[h].T) / 2
    across = noises[:, -axes:] @ step[-axes:].T
    transitions, level = spreading, None if model.integrated else _level(model)
    level_of_axis = None if level is None else level[0]
    if axes == 1:
        transitions = (spreading[:, :, None, :, None] * _EYE[:, None]).reshape(-1, AXES * size, AXES * size)
        level = None if level is None else np.asarray(np.kron(level, _EYE), dtype=float)
    return InnovationsFilter(
        level=level,
        level_of_axis=level_of_axis,
        horizon=horizon,
        one_step=transitions[1],
        transitions=tuple(transitions),
        outputs=transitions[:, -AXES:].copy(),
        n_axes=axes,
        unit=unit,
        spreading=spreading,
        noises=noises,
        noise_now=noises[:, -axes:, -axes:].copy(),
        noise_across=across + across.transpose(0, 2, 1),
        start_covariance=np.asfortranarray(_start_covariance(model)),
        unit_trace=float(np.trace(unit)),
        steps=tuple(zip(spreading.transpose(0, 2, 1), noises.transpose(0, 2, 1), strict=True)),
    )


def _of_one_axis(model: InnovationsModel) -> InnovationsModel | None:
    """Return the model of one axis, with innovations of variance 1, of one in which every axis moves alike."""
    if model.order % AXES:
        return None
    of_one = []
    for matrix in (model.A, model.C, model.K):
        one = matrix[::AXES, ::AXES]
        if not np.array_equal((one[:, None, :, None] * _EYE[:, None]).reshape(matrix.shape), matrix):
            return None
        of_one.append(one.copy())
    return replace(model, A=of_one[0], C=of_one[1], K=of_one[2], Re=np.ones((1, 1)))


def _transition(model: InnovationsModel) -> Array:
    n, axes = model.order, len(model.C)
    eye = np.eye(axes)
    if model.integrated:
        return np.block([[model.A, np.zeros((n, axes))], [model.C, eye]])
    onward = np.hstack([model.A, model.K])
    moved = model.C @ onward - np.hstack([model.C, eye])
    none = np.zeros((n + axes, axes))
    return np.block([[np.vstack([onward, np.zeros((axes, n + axes))]), none], [moved, eye]])


def _level(model: InnovationsModel) -> Array:
    """Return the rows (d, M) that give the level of a state."""
    eye = np.eye(len(model.C))
    return np.hstack([-model.C, -eye, eye])


def _noise(model: InnovationsModel) -> Array:
    n, axes = model.order, len(model.C)
    if model.integrated:
        enters = np.vstack([model.K, np.eye(axes)])
        return np.asarray(enters @ model.Re @ enters.T)
    noise = np.zeros((n + 2 * axes, n + 2 * axes))
    noise[n:, n:] = np.tile(model.Re, (2, 2))
    noise[n + axes :, n + axes :] += model.level_step**2 * model.Re
    return noise


def _start_covariance(model: InnovationsModel) -> Array:
    """Return the covariance of s after one sample: x stationary, e as ever, y certain."""
    n, axes = model.order, len(model.C)
    states, power = model.K @ model.Re @ model.K.T, model.A
    for _ in range(_MOST_DOUBLINGS):  # twice as many samples each time: A is stable
        states = states + power @ states @ power.T
        power = power @ power
    size = len(_transition(model))
    covariance = np.zeros((size, size))
    covariance[:n, :n] = (states + states.T) / 2
    if not model.integrated:
        covariance[n : n + axes, n : n + axes] = model.Re
    return covariance
