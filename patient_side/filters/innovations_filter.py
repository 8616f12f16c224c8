"""The Kalman filter of an innovations model: its matrices, computed once, its gain and its update.

The model's states follow those of the `recent_past` where a correction of the forecast
reads it.

Where all axes have identical, separate states (Kronecker products ``A x I``, ``C x I`` and ``K x I``), the covariance
of s is ``P x Re``, whichever samples arrive, P being the one of a single axis with innovations of variance 1. Then
only P, a third of the size, is computed, and a mean has a column for each axis, with one transition for all of them.

The states of an innovations model as its filter holds them: transition, noise, level and start.

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

Where the model has a `response`, all this is the movement of the command, and the arm that follows it comes after
it: its last increments, the way that it has yet to go, the command's position p, and its own position y
(`recent_past`). Samples then show both, or one of them.

Oracle: the textbook filter with the cross term, test_innovations_filter.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dgemm, dsymm
from scipy.linalg.lapack import dposv

from tis.patient_side.filters.recent_past import WAY_UNKNOWN, RecentPast, following
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import N_INCREMENTS, InnovationsModel

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


AXES = 3

_EYE = np.eye(AXES)


ARM, COMMAND, BOTH = range(3)
"""What a sample shows. BOTH: the command's position, in units of the arm, and then the arm's."""

Gain = tuple[Array, float, Array]
"""Kalman gain (M, d), expected square of the innovation, and covariance (M, M) after the update.

Of both positions the gain is (M, 2 d), and the square that of the command's innovation.
"""

_UNKNOWN_M2 = 1.0
_UNKNOWN_MOST = 1e10
"""Variance of a position that no sample shows, and its limit in units of the innovations'."""


def square_of(innovation: Array) -> float:
    """Return the square of an innovation's first three numbers."""
    # Python's arithmetic beats numpy's on three numbers.
    item = innovation.item
    x, y, z = item(0), item(1), item(2)
    return float(x * x + y * y + z * z)


def correct(mean: Array, gain: Array, sample: Array, shown: slice | None = None) -> Array:
    """Add ``gain`` (M, d) times the innovation of ``sample`` to a predicted mean, in place; return the innovation.

    Mean (M, 3/d) and sample (3,), or (M, 3 k/d) and (3, k) for k filters side by side. It is the mean's half of the
    Kalman update where the measurement is the block ``shown`` of the state, by default the last d.
    """
    d = gain.shape[1]
    innovation = sample.reshape(d, -1) - mean[-d:] if shown is None else sample.reshape(d, -1) - mean[shown]
    mean += gain.dot(innovation)
    return innovation


def follow_jump(mean: Array, gain: Array, innovation: Array, shown: slice) -> None:
    """Turn a corrected mean into that of an arm that jumped, in place: the movement goes on from the new position.

    As when a clutch is released or a set-up moved, the step says nothing of the hand's velocity. The level, which is
    no state, jumps along.
    """
    mean -= gain.dot(innovation)
    mean[shown] += innovation


class Updated(NamedTuple):
    """Mean (M, 3/d), covariance (M, M), and the innovation's square over its expectation: the surprise."""

    mean: Array
    covariance: Array
    surprise: float


@dataclass(frozen=True, eq=False)
class InnovationsFilter:
    """Matrices for steps of 0 .. H + 1 samples of M states, the last d of which are y.

    Either one state holds all d = 3 axes, M = N, or, where all axes are alike, d = ``n_axes`` = 1 and M = N/3: one
    matrix moves the states of each axis, which are the columns of a mean (M, 3/d). The covariance of all is then the
    Kronecker product of (M, M) with ``unit`` (3, 3), the innovations' covariance, of trace ``unit_trace``; else
    ``unit`` is 1.

    ``n_following`` states belong to an arm that follows a command: 0 where the arm's own movement is modelled. Its
    samples have errors of covariance ``arm_error`` (d, d), in units of ``unit``; None: they are certain.
    ``horizon`` is H, the number of samples beyond which nothing is forecast. ``transitions`` (H + 2, M, M) cover g
    steps at once, ``onward`` holds them one by one, and ``noises`` (H + 2, M, M) are the noise of g steps; ``steps``
    holds both again, transposed into BLAS's Fortran order. ``start_covariance`` (M, M) holds after a first sample
    without knowledge of the level, and ``level`` (d, M) maps a state to the level b. ``noise_now`` (H + 2, d, d) is
    the noise's share in the covariance of y[h], and ``noise_across`` in the cross covariance of y[h] and y[h + 1],
    plus its transpose. ``past`` is the recent past that the first states hold, if any, and ``n_past`` their number.
    """

    level: Array | None
    horizon: int
    transitions: Array
    onward: tuple[Array, ...]
    n_axes: int
    unit: Array
    noises: Array
    noise_now: Array
    noise_across: Array
    start_covariance: Array
    unit_trace: float
    steps: tuple[tuple[Array, Array], ...]
    past: RecentPast | None = None
    n_following: int = 0
    arm_error: Array | None = None

    @property
    def way(self) -> slice:
        """The states of the way that an arm with a pull has yet to go."""
        return slice(-3 * self.n_axes, -2 * self.n_axes)

    @property
    def n_past(self) -> int:
        """Number of states that hold the recent past; linear forecasts use those after them."""
        return 0 if self.past is None else self.past.n_states * self.n_axes

    @property
    def n_states(self) -> int:
        """Number M of states."""
        return len(self.start_covariance)

    @property
    def usual(self) -> int:
        """What a sample usually shows."""
        return BOTH if self.n_following else ARM

    def shown(self, what: int) -> slice:
        """Return the states that a sample of ``what`` shows."""
        d = self.n_axes
        return slice(-2 * d if what else -d, -d if what == COMMAND else None)

    def output(self, steps: int) -> Array:
        """Return the map (d, M) from a mean to the position ``steps`` samples later."""
        return self.transitions[steps, -self.n_axes :]

    def hand(self, steps: int) -> Array:
        """Return the map (d, M) from a mean to what moves by itself: the command, where the arm follows one."""
        return self.transitions[steps, self.shown(COMMAND)] if self.n_following else self.output(steps)

    def read(self, rows: Array, means: Array) -> Array:
        """Return what ``rows`` (K, M) read of means, one a row (R, N): (R, 3 K/d)."""
        return np.asarray(means @ np.kron(rows, np.eye(AXES // self.n_axes)).T)

    def forecasts(self, means: Array, steps: int) -> Array:
        """Return the positions (R, 3) ``steps`` samples after each of the means, one a row (R, N)."""
        n = 0 if self.n_following else self.n_past
        return self.read(self.output(steps)[:, n:], means[:, n * AXES // self.n_axes :])

    def start(self, sample: Array, error: Array | None = None, what: int | None = None) -> tuple[Array, Array]:
        """Return mean (M, 3/d) and covariance (M, M) after a first sample (3,), with its ``error`` (3, 3) if any.

        The model's states are stationary, and the level is the sample less their output. An ``error`` requires
        covariances of all axes. Of an arm that follows a command the sample is that of both (6,); one of them is a
        guess where only ``what`` is shown.
        """
        usual = self.usual
        mean, covariance = np.zeros((self.n_states, AXES // self.n_axes)), self.start_covariance
        mean[self.shown(usual)] = sample.reshape(-1, AXES // self.n_axes)
        if error is not None or what not in (None, usual):
            covariance = covariance.copy(order="F")
        if error is not None:
            covariance[-AXES:, -AXES:] += error
        elif what not in (None, usual):
            hidden = self.shown(ARM if what == COMMAND else COMMAND)
            size = self.unit_trace / AXES if self.n_axes == 1 else float(np.mean(np.diag(self.noise_now[1])))
            covariance[hidden, hidden] += min(_UNKNOWN_M2 / size, _UNKNOWN_MOST) * (
                np.eye(self.n_axes) * (1.0 if self.n_axes == 1 else size)
            )
        return mean, covariance

    def gain(self, covariance: Array, gap: int, error: Array | None = None, what: int | None = None) -> Gain:
        """Return the Kalman gain for a sample ``gap`` samples later (1 .. horizon), and the covariance after it.

        `kalman_update` in another form, see there. An ``error`` requires covariances of all axes. The sample shows
        ``what``, by default what is usual.
        """
        # Prediction. dsymm reads only the upper triangle: asymmetry by rounding does not grow from gap to gap.
        step, noise = self.steps[gap]
        covariance = dgemm(1.0, step, dsymm(1.0, covariance, step), 1.0, noise, 1)
        what = self.usual if what is None else what
        if what != BOTH:
            error = self.arm_error if error is None and what == ARM else error
            return self._shown(covariance, self.shown(what), error)
        # One after the other: the second innovation is what the first has left of it.
        last = self.shown(ARM)
        first, variance, left = self._shown(covariance, self.shown(COMMAND))
        second, _, left = self._shown(left, last, self.arm_error)
        return np.hstack([first - second.dot(first[last]), second]), variance, left

    def _shown(self, covariance: Array, shown: slice, error: Array | None = None) -> Gain:
        """Return the gain where a sample shows a block of d states; the covariance is overwritten."""
        if self.n_axes == 1:
            # Update by one axis: its variance is a scalar.
            expected_square = covariance.item(shown.start, shown.start)
            if error is not None:
                expected_square += error.item()
            column = covariance[:, shown] / expected_square
            left = dgemm(-expected_square, column, column, 1.0, covariance, 0, 1, 1)
            return column, expected_square * self.unit_trace, left
        # Update by three axes: K' solves (H P H' + R) K' = H P; P - P H' K' overwrites P, hence the copy.
        columns = covariance[:, shown].copy("F")
        expected = columns[shown] if error is None else columns[shown] + error
        _, rows, _ = dposv(expected, columns.T)
        left = dgemm(-1.0, columns, rows, 1.0, covariance, 0, 0, 1)
        square = expected.item
        return rows.T, square(0) + square(4) + square(8), left

    def update(self, mean: Array, covariance: Array, gap: int, sample: Array, error: Array | None = None) -> Updated:
        """Return mean and covariance ``gap`` samples later (1 .. horizon), given the sample (3,) there.

        Oracles: one-shot conditioning of the joint Gaussian, and a textbook filter with the cross term.
        """
        weights, variance, left = self.gain(covariance, gap, error)
        mean = self.onward[gap].dot(mean)
        innovation = correct(mean, weights, sample)
        return Updated(mean, left, square_of(innovation) / variance)

    def weights(self, steps: int, fraction: float) -> Array:
        """Return the map (d, M) from a mean to the position ``steps + fraction`` samples later; ``steps`` <= horizon.

        Truth is linear between sample instants. Oracle: a dense interpolation of the forecasts of whole samples.
        """
        return np.asarray((1.0 - fraction) * self.output(steps) + fraction * self.output(steps + 1))

    def noise(self, steps: int, fraction: float) -> Array:
        """Return the noise's share (d, d), in units of ``unit``, in the covariance of that forecast."""
        here = 1.0 - fraction
        noise = (here * here) * self.noise_now[steps]
        noise += (fraction * fraction) * self.noise_now[steps + 1]
        noise += (here * fraction) * self.noise_across[steps]
        return np.asarray(noise)

    def spread(self, covariance: Array, steps: int, fraction: float) -> Array:
        """Return the covariance (3, 3) of that forecast. Oracle: one-shot conditioning of the joint Gaussian."""
        weights = self.weights(steps, fraction)
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
    assert model.response is None or past is not None, "an arm follows the command's last increments"
    # One step; later 0 .. H + 1 of them.
    step, process_noise, axes = transition(model), noise(model), len(model.C)
    start = start_covariance(model)
    n_past = 0 if past is None else past.n_states * axes
    if past is not None:
        step, process_noise = past.before(step, process_noise, axes)
        start = np.pad(start, (n_past, 0))
    mean_level = None if model.integrated else np.pad(level(model), ((0, 0), (n_past, 0)))
    n_hand, arm_error = len(step), None
    if model.response is not None:
        step, process_noise, place = following(model.response, step, process_noise, model.Re)
        # The last increments are as unknown as the next one: a first move does not answer a large command.
        move = step[place[-axes:]] - np.eye(len(step))[place[-axes:]]
        start = _spread_out(start, place, len(step))
        unknown = move @ start @ move.T + process_noise[np.ix_(place[-axes:], place[-axes:])]
        for first in (0, n_hand - axes):
            lags = slice(first, first + N_INCREMENTS * axes)
            start[lags, lags] = np.kron(np.eye(N_INCREMENTS), unknown)
        if model.response.error:
            arm_error = model.response.error * model.Re
            start[-axes:, -axes:] += arm_error
        if model.response.pull:
            start[-3 * axes : -2 * axes, -3 * axes : -2 * axes] = WAY_UNKNOWN * model.Re
        mean_level = None if mean_level is None else _spread_out(mean_level, place, len(step), axes)
    transitions, noises = _of_steps(step, process_noise, horizon + 1)
    across = noises[:, -axes:] @ step[-axes:].T
    return InnovationsFilter(
        level=mean_level,
        horizon=horizon,
        transitions=transitions,
        onward=tuple(transitions),
        n_axes=axes,
        unit=unit,
        noises=noises,
        noise_now=noises[:, -axes:, -axes:].copy(),
        noise_across=across + across.transpose(0, 2, 1),
        start_covariance=np.asfortranarray(start),
        unit_trace=float(np.trace(unit)),
        steps=tuple(zip(transitions.transpose(0, 2, 1), noises.transpose(0, 2, 1), strict=True)),
        past=past,
        n_following=len(step) - n_hand,
        arm_error=arm_error,
    )


def _of_steps(step: Array, process_noise: Array, n_steps: int) -> tuple[Array, Array]:
    """Return transitions and noise (n + 1, M, M) of 0 .. n steps at once."""
    size = len(step)
    transitions, noises = np.empty((n_steps + 1, size, size)), np.zeros((n_steps + 1, size, size))
    transitions[0] = np.eye(size)
    for h in range(1, n_steps + 1):
        transitions[h] = step @ transitions[h - 1]
        noises[h] = step @ noises[h - 1] @ step.T + process_noise
        noises[h] = (noises[h] + noises[h].T) / 2
    return transitions, noises


def _spread_out(values: Array, place: NDArray[np.intp], size: int, n_rows: int | None = None) -> Array:
    """Return a matrix over all states from one over those at ``place``, whose rows are states unless ``n_rows``."""
    whole = np.zeros((size if n_rows is None else n_rows, size))
    whole[np.ix_(place if n_rows is None else np.arange(n_rows), place)] = values
    return whole


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
