"""Training trials as arrays: the checks before an identification, and its scaling."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tis.common.errors import DataError, Fault
from tis.patient_side.statespace import Array, StateSpace

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
) -> None:
    """Raise `DataError` with every fault: transposed or unequal arrays, NaN, no movement, too few rows.

    The Hankel matrix needs as many columns as rows, when the share ``held_back`` of each trial's rows is set
    aside: ``N - 2 s + 1 >= 2 s (m + p)`` with ``past`` and future block rows, else ``N - s + 1 >= s (m + p)``.
    """
    names = labels or [f"trial {i}" for i in range(1, len(trials) + 1)]
    faults: list[Fault] = []
    if not trials:
        faults.append(Fault("identification", "trials", "needs at least one trial"))
    for name, (u, y) in zip(names, trials, strict=True):
        faults += _shape_faults(name, u, y)
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


def _shape_faults(name: str, u: Array, y: Array) -> list[Fault]:
    faults = []
    for side, signal in (("input", u), ("output", y)):
        if signal.ndim != 2 or signal.shape[1] < 1:
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
                rule = "must move: it is constant over the training rows"
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
