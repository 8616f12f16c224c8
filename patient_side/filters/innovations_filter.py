"""The Kalman filter of an innovations model: its matrices, computed once, its gain and its update.

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

Before these states come those of the `recent_past`, where a correction of the forecast reads it.

Where all axes have identical, separate states (Kronecker products ``A x I``, ``C x I`` and ``K x I``), the covariance
of s is ``P x Re``, whichever samples arrive, P being the one of a single axis with innovations of variance 1. Then
only P, a third of the size, is computed.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.linalg.blas import dgemm, dsymm
from scipy.linalg.lapack import dposv

from patient_side.filters.recent_past import RecentPast
from patient_side.statespace import Array, InnovationsModel

AXES = 3

_EYE = np.eye(AXES)
_EYE_ROW = _EYE.reshape(1, AXES * AXES)
_MAX_DOUBLINGS = 40


Gain = tuple[Array, float, Array]
"""Kalman gain (N, 3), expected square of the innovation, and covariance (M, M) after the update."""


def square_of(innovation: Array) -> float:
    """Return the square of an innovation (3,)."""
    # Python's arithmetic beats numpy's on three numbers.
    x, y, z = innovation.tolist()
    return float(x * x + y * y + z * z)


def correct(mean: Array, gain: Array, sample: Array) -> Array:
    """Add ``gain`` times the innovation of ``sample`` to a predicted mean, in place; return the innovation.

    Shapes (N,), (N, 3), (3,), or (N, k) and (3, k) for k filters side by side. It is the mean's half of the Kalman
    update where the measurement is the last block of the state.
    """
    innovation = sample - mean[-AXES:]
    mean += gain.dot(innovation)
    return innovation


class Updated(NamedTuple):
    """Mean (N,), covariance (M, M), and the surprise: the innovation's square over its expectation, 1 on average."""

    mean: Array
    covariance: Array
    surprise: float


@dataclass(frozen=True, eq=False)
class InnovationsFilter:
    """Matrices for N states, the last 3 of which are y, and for steps of 0 .. H + 1 samples.

    ``level`` (3, N) maps a state to the level b, ``level_of_axis`` (M,) the states of a covariance to b's first axis.
    ``past`` is the recent past that the first states hold, if any, and ``n_past`` their number in a covariance.

    ``horizon`` is H, the number of samples beyond which nothing is forecast. ``transitions``, H + 2 of (N, N),
    cover g steps at once, ``one_step`` a single one, and ``outputs`` (H + 2, 3, N) are their rows for y.

    Covariances (M, M) cover all states, ``n_axes`` = 3 and M = N, or those of one axis, ``n_axes`` = 1 and M = N/3:
    then the whole is the Kronecker product with ``unit`` (3, 3), the innovations' covariance, of trace
    ``unit_trace``; else ``unit`` is 1. ``spreading`` (H + 2, M, M) are the transitions of a covariance, ``noises``
    (H + 2, M, M) the noise of g steps; ``steps`` holds both again, transposed into BLAS's Fortran order.
    ``start_covariance`` (M, M) holds after a first sample without knowledge of the level. ``noise_now``
    (H + 2, d, d), d axes, is the noise's share in the covariance of y[h], and ``noise_across`` in the cross
    covariance of y[h] and y[h + 1], plus its transpose.
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
    past: RecentPast | None = None

    @property
    def n_past(self) -> int:
        """Number of a covariance's states that hold the recent past."""
        return 0 if self.past is None else self.past.n_states * self.n_axes

    @property
    def first(self) -> int:
        """Place in a mean of the first state that linear forecasts use: those of the recent past come before."""
        return 0 if self.past is None else AXES * self.past.n_states

    def start(self, sample: Array, error: Array | None = None) -> tuple[Array, Array]:
        """Return mean (N,) and covariance (M, M) after a first sample (3,), of covariance ``error`` (3, 3) if any.

        The model's states are stationary, and the level is the sample less their output. An ``error`` requires
        covariances of all axes.
        """
        mean, covariance = np.zeros(len(self.one_step)), self.start_covariance
        mean[-AXES:] = sample
        if error is not None:
            covariance = covariance.copy(order="F")
            covariance[-AXES:, -AXES:] += error
        return mean, covariance

    def gain(self, covariance: Array, gap: int, error: Array | None = None) -> Gain:
        """Return the Kalman gain for a sample (3,) ``gap`` samples later (1 .. horizon), and the covariance after it.

        `kalman_update` in another form, see there. An ``error`` requires covariances of all axes.
        """
        # Prediction. dsymm reads only the upper triangle: asymmetry by rounding does not grow from gap to gap.
        step, noise = self.steps[gap]
        covariance = dgemm(1.0, step, dsymm(1.0, covariance, step), 1.0, noise, 1)
        if self.n_axes == 1:
            # Update by one axis: y is the last state, its variance a scalar; the gain of all axes is column x I.
            expected_square = covariance.item(-1)
            column = covariance[:, -1:] / expected_square
            left = dgemm(-expected_square, column, column, 1.0, covariance, 0, 1, 1)
            return column.dot(_EYE_ROW).reshape(-1, AXES), expected_square * self.unit_trace, left
        # Update by three axes: K' solves (H P H' + R) K' = H P; P - P H' K' overwrites P, hence the copy.
        columns = covariance[:, -AXES:].copy("F")
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
        innovation = correct(mean, weights, sample)
        return Updated(mean, left, square_of(innovation) / variance)

    def weights(self, steps: int, fraction: float) -> Array:
        """Return the map (3, N) from a mean to the position ``steps + fraction`` samples later; ``steps`` <= horizon.

        Truth is linear between sample instants. Oracle: a dense interpolation of the forecasts of whole samples.
        """
        return np.asarray((1.0 - fraction) * self.outputs[steps] + fraction * self.outputs[steps + 1])

    def spread_weights(self, steps: int, fraction: float) -> Array:
        """Return the same map (d, M) for covariances."""
        here, there = self.spreading[steps, -self.n_axes :], self.spreading[steps + 1, -self.n_axes :]
        return np.asarray((1.0 - fraction) * here + fraction * there)

    def noise(self, steps: int, fraction: float) -> Array:
        """Return the noise's share (d, d), in units of ``unit``, in the covariance of that forecast."""
        here = 1.0 - fraction
        noise = (here * here) * self.noise_now[steps]
        noise += (fraction * fraction) * self.noise_now[steps + 1]
        noise += (here * fraction) * self.noise_across[steps]
        return np.asarray(noise)

    def spread(self, covariance: Array, steps: int, fraction: float) -> Array:
        """Return the covariance (3, 3) of that forecast. Oracle: one-shot conditioning of the joint Gaussian."""
        weights = self.spread_weights(steps, fraction)
        return np.asarray((self.noise(steps, fraction) + weights.dot(covariance).dot(weights.T)) * self.unit)


def build_innovations_filter(
    model: InnovationsModel, horizon: int, *, whole: bool = False, past: RecentPast | None = None
) -> InnovationsFilter:
    """Return the filter of a model; nothing is forecast over more than ``horizon`` (>= 1) samples.

    ``whole``: covariances of all axes even where one axis is enough, as samples with errors of their own require.
    ``past``: the recent past that the filter holds as well.
    """
    # One axis stands for all three where they are identical.
    one_axis = None if whole else _of_one_axis(model)
    unit = np.ones((1, 1)) if one_axis is None else model.Re
    if one_axis is not None:
        model = one_axis
    # Transitions and noise of 0 .. H + 1 steps.
    step, noise, axes = _transition(model), _noise(model), len(model.C)
    start = _start_covariance(model)
    n_past = 0 if past is None else past.n_states * axes
    if past is not None:
        step, noise = past.before(step, noise, axes)
        start = np.pad(start, (n_past, 0))
    size = len(step)
    spreading, noises = np.empty((horizon + 2, size, size)), np.zeros((horizon + 2, size, size))
    spreading[0] = np.eye(size)
    for h in range(1, horizon + 2):
        spreading[h] = step @ spreading[h - 1]
        noises[h] = step @ noises[h - 1] @ step.T + noise
        noises[h] = (noises[h] + noises[h].T) / 2
    across = noises[:, -axes:] @ step[-axes:].T
    # The mean always has three axes.
    transitions, level = spreading, None if model.integrated else np.pad(_level(model), ((0, 0), (n_past, 0)))
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
        start_covariance=np.asfortranarray(start),
        unit_trace=float(np.trace(unit)),
        steps=tuple(zip(spreading.transpose(0, 2, 1), noises.transpose(0, 2, 1), strict=True)),
        past=past,
    )


def _of_one_axis(model: InnovationsModel) -> InnovationsModel | None:
    """Return the model of one axis, with innovations of variance 1; None unless all three axes are identical."""
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
    """Return the map (d, M) from a state to its level."""
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
    """Return the covariance of s after one sample: stationary x, e with its own covariance, certain y."""
    n, axes = model.order, len(model.C)
    states, power = model.K @ model.Re @ model.K.T, model.A
    # The stationary covariance, by doubling: each pass covers twice as many samples, and A is stable.
    for _ in range(_MAX_DOUBLINGS):
        states = states + power @ states @ power.T
        power = power @ power
    size = len(_transition(model))
    covariance = np.zeros((size, size))
    covariance[:n, :n] = (states + states.T) / 2
    if not model.integrated:
        covariance[n : n + axes, n : n + axes] = model.Re
    return covariance
