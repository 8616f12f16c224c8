"""Forecast errors of an innovations model on positions that it was not fitted to, some samples ahead.

The filter runs over each trial from its first row, as in a run, and its forecasts are compared with the rows
held back. All trials run side by side: they share their gains, which do not depend on data.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from tis.patient_side.filters.activity import ActivityMean
from tis.patient_side.filters.innovations_filter import AXES, InnovationsFilter, correct
from tis.patient_side.filters.unbroken import Unbroken
from tis.patient_side.statespace import Array

T = TypeVar("T")

_MIN_SHARE = 1e-12


@dataclass(frozen=True)
class HeldBack:
    """Positions (N_i, 3) of trials in m; the rows of each from ``first_rows`` on are held back.

    ``grippers_rad`` (N_i,) are the grippers' angles at these rows, and ``people`` who moves in each trial, where they
    are known.
    """

    outputs: tuple[Array, ...]
    first_rows: tuple[int, ...]
    grippers_rad: tuple[Array, ...] = ()
    people: tuple[str, ...] = ()

    def of_trials(self, chosen: NDArray[np.intp]) -> "HeldBack":
        """Return some of the trials."""

        def some(each: tuple[T, ...]) -> tuple[T, ...]:
            return tuple(each[i] for i in chosen) if each else ()

        return HeldBack(some(self.outputs), some(self.first_rows), some(self.grippers_rad), some(self.people))

    @property
    def n_rows(self) -> int:
        """Return the largest number of rows held back of a trial."""
        return max(len(y) - first for y, first in zip(self.outputs, self.first_rows, strict=True))

    def moves(self, steps: int) -> list[Array]:
        """Return the moves (M_i, 3) of positions over ``steps`` samples: the errors of hold."""
        both = zip(self.outputs, self.first_rows, strict=True)
        return [y[first:][steps:] - y[first:][:-steps] for y, first in both]

    def forecast_errors(self, filter_: InnovationsFilter, means: Sequence[Array], steps: int) -> list[Array]:
        """Return the errors (M_i, 3) of forecasts over ``steps`` samples from `filtered`'s means, like `moves`."""
        each = zip(self.outputs, self.first_rows, means, strict=True)
        return [y[first:][steps:] - filter_.forecasts(state[:-steps], steps) for y, first, state in each]

    def filtered(self, filter_: InnovationsFilter, unbroken: Unbroken) -> list[Array]:
        """Return the filter's means (N_i - first_i, N) after each of the rows held back. Oracle: the estimator."""
        means, _ = self.run(filter_, unbroken, None)
        return means

    def run(
        self, filter_: InnovationsFilter, unbroken: Unbroken, activity: ActivityMean | None
    ) -> tuple[list[Array], list[Array]]:
        """Return the means, and the ``activity``'s factors on covariances (N_i - first_i,), 1 without one."""
        # Trials side by side, as columns; shorter ones are padded with zeros.
        n_trials, length, earliest = len(self.outputs), max(map(len, self.outputs)), min(self.first_rows)
        rows = np.zeros((length, AXES, n_trials))
        for i, y in enumerate(self.outputs):
            rows[: len(y), :, i] = y
        # The filter in an unbroken row; the means from the first row held back on are kept.
        step = filter_.onward[1]
        means = np.stack([filter_.start(y[0])[0] for y in self.outputs], axis=2).reshape(filter_.n_states, -1)
        kept, factors = np.empty((length - earliest, *means.shape)), np.ones((length, n_trials))
        surprises = np.ones((length, n_trials))
        for k in range(length):
            if k:
                stage = unbroken.stage(k + 1)
                means = step.dot(means)
                innovation = correct(means, unbroken.gains[stage], rows[k])
                if activity is not None:
                    surprises[k] = np.square(innovation).reshape(AXES, -1).sum(axis=0) / unbroken.variances[stage]
            if k >= earliest:
                kept[k - earliest] = means
        if activity is not None:
            for i in range(n_trials):
                factors[:, i] = _factors(activity, surprises[:, i])
        # Each trial's own rows.
        kept = kept.reshape(len(kept), -1, n_trials)
        both = list(zip(self.outputs, self.first_rows, strict=True))
        return (
            [kept[first - earliest : len(y) - earliest, :, i] for i, (y, first) in enumerate(both)],
            [factors[first : len(y), i] for i, (y, first) in enumerate(both)],
        )


def _factors(activity: ActivityMean, surprises: Array) -> Array:
    """Return the factor after each surprise; the first row has no forecast and keeps the initial factor."""
    now = activity.initial()
    factors = [now[0]]
    for surprise in surprises[1:].tolist():
        now = activity.after(now, surprise)
        factors.append(now[0])
    return np.array(factors)


def error_over_hold(
    held_back: HeldBack, filter_: InnovationsFilter, unbroken: Unbroken, horizons: Sequence[int]
) -> float:
    """Return the geometric mean, over trials and ``horizons``, of the rms error of forecasts over that of hold.

    A relative improvement then counts equally at 33 ms, where errors are small, and at a second, and equally in a
    quiet trial and in one with large movements, whose squares would outweigh all others.
    """
    means, shares = held_back.filtered(filter_, unbroken), []
    for steps in horizons:
        errors = held_back.forecast_errors(filter_, means, steps)
        for missed, moved in zip(errors, held_back.moves(steps), strict=True):
            total = float(np.sum(np.square(moved)))
            if total > 0:
                shares.append(max(float(np.sum(np.square(missed))) / total, _MIN_SHARE))
    return float(np.exp(np.mean(np.log(shares)) / 2)) if shares else 0.0
