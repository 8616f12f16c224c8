"""Training trials as arrays: the checks before an identification, and its scaling.

Groups of training rows that are held out together.

Breakdown of linear algebra on unsuitable training rows, as a fault with a remedy.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.common.errors import DataError, Fault
from tis.patient_side.linear_system import Array, StateSpace

Trial = tuple[Array, Array]
"""Inputs (N, m) and outputs (N, p) of one uninterrupted stretch, row by row."""

_MIN_RANGE, _MAX_VALUE = 1e-70, 1e70
"""Beyond these, squares and their products underflow or overflow in double precision."""


def check_trials(
    trials: Sequence[Trial],
    block_rows: int,
    labels: Sequence[str] | None = None,
    held_back: float = 0.0,
    *,
    past: bool = True,
    fewest_inputs: int = 1,
) -> None:
    """Raise `DataError` with every fault: transposed or unequal arrays, NaN, no movement, too few rows.

    ``fewest_inputs`` is 0 where outputs alone are a trial.

    The Hankel matrix needs as many columns as rows, when the share ``held_back`` of each trial's rows is set
    aside: ``N - 2 s + 1 >= 2 s (m + p)`` with ``past`` and future block rows, else ``N - s + 1 >= s (m + p)``.
    """
    names = labels or [f"trial {i}" for i in range(1, len(trials) + 1)]
    faults: list[Fault] = []
    if not trials:
        faults.append(Fault("identification", "trials", "needs at least one trial"))
    for name, (u, y) in zip(names, trials, strict=True):
        faults += _shape_faults(name, u, y, fewest_inputs)
    if not faults and len({(u.shape[1], y.shape[1]) for u, y in trials}) > 1:
        faults.append(Fault("identification", "trials", "all must have the same numbers of inputs and outputs"))
    if faults:
        raise DataError(faults)
    for name, (u, y) in zip(names, trials, strict=True):
        faults += finite_faults(name, u, y)
    if not faults:
        faults = _constant_faults(trials) + _length_faults(trials, block_rows, held_back, past)
    if faults:
        raise DataError(faults)


def finite_faults(name: str, u: Array, y: Array) -> list[Fault]:
    """Return a fault for each of the signals (N, m), (N, p) that contains NaN or infinity."""
    faults = []
    for side, signal in (("input", u), ("output", y)):
        wrong = int(np.count_nonzero(~np.isfinite(signal)))
        if wrong:
            row = int(np.flatnonzero(~np.isfinite(signal).all(axis=1))[0])
            faults.append(Fault(name, side, f"must be finite: {wrong} values are not, the first in row {row}"))
    return faults


def _shape_faults(name: str, u: Array, y: Array, fewest_inputs: int) -> list[Fault]:
    faults = []
    for side, signal, fewest in (("input", u, fewest_inputs), ("output", y, 1)):
        if signal.ndim != 2 or signal.shape[1] < fewest:
            faults.append(Fault(name, side, "must have the shape (samples, channels)", signal.shape))
        elif signal.shape[0] < signal.shape[1]:
            rule = "must have one row per sample, and no fewer rows than columns: too short, or transposed"
            faults.append(Fault(name, side, rule, signal.shape))
    if not faults and len(u) != len(y):
        faults.append(Fault(name, "output", f"must have as many rows as the input, {len(u)}", len(y)))
    return faults


def _constant_faults(trials: Sequence[Trial]) -> list[Fault]:
    faults = []
    for side, signals in (("input", [u for u, _ in trials]), ("output", [y for _, y in trials])):
        ranges = np.max([np.ptp(signal, axis=0) for signal in signals], axis=0)
        sizes = np.max([np.max(np.abs(signal), axis=0) for signal in signals], axis=0)
        for channel, (moved, size) in enumerate(zip(ranges, sizes, strict=True)):
            if moved == 0:
                rule = "must move, it is constant in the training rows: at rest it needs sensor_noise_mm: 0.01"
                faults.append(Fault("identification", f"{side} {channel}", rule))
            elif moved <= _MIN_RANGE or size >= _MAX_VALUE:
                rule = f"must move by more than {_MIN_RANGE:g} and stay below {_MAX_VALUE:g}: use another unit"
                faults.append(Fault("identification", f"{side} {channel}", rule))
    return faults


def n_first(n_rows: int, held_back: float) -> int:
    """Return the number of rows left when the share ``held_back`` of them, rounded down, is set aside."""
    return n_rows - int(held_back * n_rows)


def _length_faults(trials: Sequence[Trial], block_rows: int, held_back: float, past: bool) -> list[Fault]:
    u, y = trials[0]
    window = 2 * block_rows if past else block_rows
    n_directions = window * (u.shape[1] + y.shape[1])
    n_columns = sum(max(0, n_first(len(u), held_back) - window + 1) for u, _ in trials)
    if n_columns >= n_directions:
        return []
    needed = n_directions + window - 1
    while n_first(needed, held_back) < n_directions + window - 1:
        needed += 1
    aside = f", {100 * held_back:.0f} % of them to validate on" if held_back else ""
    rule = (
        f"{block_rows} block rows, {u.shape[1]} inputs and {y.shape[1]} outputs need {needed} rows in one"
        f" trial{aside}: {n_directions} Hankel columns, here {n_columns}"
    )
    return [Fault("identification", "training rows", rule, sum(len(u) for u, _ in trials))]


@dataclass(frozen=True)
class Scaling:
    """Units of the inputs (m,) and the outputs (p,) in which a model is identified."""

    input: Array
    output: Array

    @classmethod
    def of(cls, trials: Sequence[Trial]) -> "Scaling":
        """Return the pooled deviations, each about its own trial's mean; positive where `check_trials` passed."""
        return cls(_deviation([u for u, _ in trials]), _deviation([y for _, y in trials]))

    @classmethod
    def by_range(cls, trials: Sequence[Trial]) -> "Scaling":
        """Return the ranges, highest less lowest value over all trials; positive where `check_trials` passed."""
        inputs, outputs = np.concatenate([u for u, _ in trials]), np.concatenate([y for _, y in trials])
        return cls(np.ptp(inputs, axis=0), np.ptp(outputs, axis=0))

    def scaled(self, trials: Sequence[Trial]) -> list[Trial]:
        """Return copies of the trials in these units."""
        return [(u / self.input, y / self.output) for u, y in trials]

    def unscaled(self, space: StateSpace) -> StateSpace:
        """Return a model of scaled signals as one of the original signals; the state is unchanged."""
        out = self.output[:, None]
        return StateSpace(space.A, space.B / self.input, out * space.C, out * space.D / self.input)


def _deviation(signals: Sequence[Array]) -> Array:
    squares = np.sum([np.square(signal - signal.mean(axis=0)).sum(axis=0) for signal in signals], axis=0)
    return np.asarray(np.sqrt(squares / sum(len(signal) for signal in signals)))


_MAX_GROUPS = 6


def held_out_groups(lengths: Sequence[int], people: Sequence[str]) -> list[NDArray[np.intp]]:
    """Return the group of every row, by trial of ``lengths`` rows.

    With several ``people``, whose names are in the order of the trials, a group is a person, or several where they
    are more than six: what is fitted must serve a person whom it has not seen. Otherwise it is a stretch of rows, six
    in all or one for each trial. Stretches of a trial lie one after another.
    """
    names = sorted(set(people))
    if len(names) > 1:
        of_name = {name: i * min(_MAX_GROUPS, len(names)) // len(names) for i, name in enumerate(names)}
        return [np.full(n, of_name[name]) for n, name in zip(lengths, people, strict=True)]
    n_stretches = -(-_MAX_GROUPS // len(lengths))
    return [i * n_stretches + np.arange(n) * n_stretches // max(n, 1) for i, n in enumerate(lengths)]


_MIN_REPEATED_SHARE: Final = 0.5


@contextmanager
def breakdown_as_fault(method: str) -> Iterator[None]:
    """Raise `DataError` where linear algebra fails inside, for example on values that overflow.

    Each method handles rank deficiency and unstable poles itself; this covers the remaining cases. Oracle:
    staircases of any step and noise give a model or a fault, test_staircase.
    """
    try:
        yield
    except np.linalg.LinAlgError as error:
        rule = f"{method} breaks down on them ({error}): choose another method, fewer block rows or more rows"
        raise DataError(Fault("identification", "training rows", rule)) from error


@contextmanager
def explain_repeats(commands_m: Sequence[Array]) -> Iterator[None]:
    """Add a hint to a `DataError` from inside where most rows of the commands (N, 3) repeat the row before.

    A recorder slower than the rows causes such staircases; a smooth movement, also of weak excitation, has none.
    """
    try:
        yield
    except DataError as error:
        same = [(np.diff(positions, axis=0) == 0.0).all(axis=1) for positions in commands_m]
        share = float(np.mean(np.concatenate([np.zeros(1), *same])))
        if share < _MIN_REPEATED_SHARE:
            raise
        rule = (
            f"{share:.0%} of them repeat the row before, as with a recorder slower than the rows: a synthetic source"
            " gives each row its own instant with source.recorder_hz=null"
        )
        raise DataError([*error.faults, Fault("identification", "training rows", rule)]) from error
