"""Training rows of a correction: its scales, clock and features, and the rows in these units."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import log
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.patient_side.filters.correction import (
    clock_of,
    compressed,
    fade,
    largest_increment,
    log_speed,
    movement_terms,
    movements,
    openness,
    projections,
)
from tis.patient_side.filters.heads import Surroundings
from tis.patient_side.filters.innovations_filter import AXES, InnovationsFilter
from tis.patient_side.filters.row_clock import N_CLOCK_TERMS, evidence_of, terms_of
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import N_INCREMENTS, N_PARTS, N_TERMS, Correction

# The frequency of the clock behind the rows, from the evidence of training rows.

_RESOLUTION = 32768
_MIN_SHARE = 0.05
_CHANCE = 10.0
"""A line of chance exceeds log(frequencies) by this much with a probability of e^-10."""
_LOWEST = 0.02


def find_row_clock(evidence: Sequence[Array]) -> float:
    """Return the frequency in cycles per row of a line in the spectra of ``evidence`` (N_i,), 0 where there is none.

    The line is at the same frequency in all recordings, with a phase of its own in each. It must hold a twentieth of
    the evidence's power, as the pattern of a recorder's clock does and human movement does not, and more than a line
    of chance. Recordings of rows on an even clock have none. Oracle: rows picked from a source of known rate.
    """
    used = [each for each in evidence if len(each) and np.any(each)]
    if not used:
        return 0.0
    # Power of the best sinusoid at each frequency, per recording; its share of the whole power.
    frequencies = np.fft.rfftfreq(_RESOLUTION)
    power = np.zeros(len(frequencies))
    for each in used:
        for first in range(0, len(each), _RESOLUTION):
            part = each[first : first + _RESOLUTION]
            power += 2.0 * np.square(np.abs(np.fft.rfft(part, _RESOLUTION))) / len(part)
    power[frequencies < _LOWEST] = 0.0
    at = int(power.argmax())
    n_rows = sum(map(len, used))
    whole = sum(float(each @ each) for each in used)
    share = float(power[at]) / whole
    by_chance = 2.0 * (len(used) + log(n_rows / 2 + 1) + _CHANCE) / n_rows
    return float(frequencies[at]) if share > max(_MIN_SHARE, by_chance) else 0.0


N_FEATURES = 128
_LARGE = 1.5
"""Way to a mean that counts as large, in deviations."""
_SPAN_S = 0.1
_OUTER = 0.005
"""Share of the training rows' speeds at either end that are limited to the range of the others."""
_LARGEST = 0.999
"""Share of the training rows whose increments do not fade the coefficients."""


class CorrectionRows(NamedTuple):
    """One trial: positions (M, 3) in m, the filter's means (M, N) and activity (M,), and the gripper's angle (M,).

    Rows of the same ``group`` (M,) are held out together. ``around`` is what heads look back on; None where there are
    to be no heads.
    """

    position_m: Array
    means: Array
    activity: Array
    gripper_rad: Array
    group: NDArray[np.intp]
    around: Surroundings | None = None


def correction_span(rate_hz: int) -> int:
    """Return the number of samples that a hand's velocity is averaged over; its acceleration takes twice as many."""
    return max(1, round(_SPAN_S * rate_hz))


def short(values: Array, digits: int = 4) -> Array:
    """Return numbers of few digits: they are many, and stand in the model file and in each log."""
    return np.array([float(f"{value:.{digits}g}") for value in values.ravel()]).reshape(values.shape)


def without_weights(trials: Sequence[CorrectionRows], filter_: InnovationsFilter, rate_hz: int) -> Correction:
    """Return the correction's scales, clock and features, with no horizons yet."""
    span = correction_span(rate_hz)
    moved = [movements(filter_, span, each.means) for each in trials]
    activity = np.maximum(np.concatenate([each.activity for each in trials]), 1e-30)
    speeds = np.concatenate([np.sum(each.velocity**2, axis=1) for each in moved]) / activity
    usual_m = max(float(np.sqrt(np.mean(speeds))), 1e-12)
    x = log_speed(np.concatenate([each.velocity for each in moved]), usual_m * np.sqrt(activity))
    lowest, highest = (float(each) for each in np.quantile(x, (_OUTER, 1 - _OUTER)))
    unit = usual_m * np.sqrt(activity)
    increments = np.concatenate([largest_increment(each, np.ones(len(each.parts))) for each in moved]) / unit
    angles = np.concatenate([each.gripper_rad for each in trials])
    # The ways to means, and the clock behind the rows.
    ways = np.concatenate([each.ways for each in moved]) / unit[:, None, None]
    widths = np.maximum(_LARGE * np.sqrt(np.mean(ways**2, axis=(0, 2))), 1e-6)
    evidence = [
        evidence_of(each.means[:, : AXES * N_INCREMENTS], each.activity, usual_m / span)[0][N_INCREMENTS:]
        for each in trials
    ]
    # Mean and deviation of the features' inputs.
    x = np.clip(x, lowest, highest)
    g = openness(angles, float(angles.mean()), float(angles.std()))
    inputs = compressed(ways, np.ones(len(ways)), widths, x, g)
    return Correction(
        span=span,
        usual_m=usual_m,
        lowest=lowest,
        highest=highest,
        largest=max(float(np.quantile(increments, _LARGEST)), 1e-6),
        gripper_usual_rad=float(angles.mean()),
        gripper_spread_rad=float(angles.std()),
        clock=find_row_clock(evidence),
        horizons=np.empty(0),
        weights=np.empty((0, N_PARTS, N_TERMS)),
        widths=widths,
        centre=short(inputs.mean(axis=0)),
        deviation=short(np.maximum(inputs.std(axis=0), 1e-6)),
        fourier=np.empty((0, AXES, N_FEATURES)),
        linear_scale=np.empty(0),
    )


@dataclass(frozen=True)
class PreparedRows:
    """A trial, with all vectors in units of the hand's usual move ``unit`` (M,).

    ``parts`` (M, 7, 3) are without the forecast move, ``terms`` (M, 15) are faded, Fourier ``features`` (M, n) are in
    single precision, and ``blocks`` are the groups of rows.
    """

    rows: CorrectionRows
    unit: Array
    parts: Array
    terms: Array
    features: NDArray[np.float32]
    blocks: list[tuple[int, slice]]
    _forecasts: dict[int, tuple[Array, Array]] = field(default_factory=dict)

    @classmethod
    def of(cls, rows: CorrectionRows, model: Correction, filter_: InnovationsFilter) -> "PreparedRows":
        """Return the rows of one trial, in units of its hand, with the terms and features of ``model``."""
        moved = movements(filter_, model.span, rows.means)
        unit = model.usual_m * np.sqrt(np.maximum(rows.activity, 1e-30))
        x = np.clip(log_speed(moved.velocity, unit), model.lowest, model.highest)
        g = openness(rows.gripper_rad, model.gripper_usual_rad, model.gripper_spread_rad)
        clock = clock_of(model)
        phase = np.zeros((len(unit), N_CLOCK_TERMS))
        if clock is not None:
            phase = terms_of(clock, rows.means[:, : AXES * N_INCREMENTS], rows.activity)
        terms = np.hstack([movement_terms(moved, x, g), phase])
        drawn = projections(model.centre, model.deviation, N_FEATURES)
        angles = compressed(moved.ways, unit, model.widths, x, g) @ drawn[:, :-1].T + drawn[:, -1]
        share = fade(largest_increment(moved, unit), model.largest)
        return cls(
            rows,
            unit,
            moved.parts / unit[:, None, None],
            share[:, None] * terms,
            np.cos(angles.astype(np.float32)),
            _blocks(rows.group),
        )

    def forecast(self, filter_: InnovationsFilter, h: int) -> tuple[Array, Array]:
        """Return the linear forecast's move and its error (M - h, 3)."""
        found = self._forecasts.get(h)
        if found is None:
            y, n = self.rows.position_m, max(0, len(self.unit) - h)
            unit = self.unit[:n, None]
            move = (filter_.forecasts(self.rows.means[:n], h) - y[:n]) / unit
            found = self._forecasts[h] = move, (y[h : h + n] - y[:n]) / unit - move
        return found


def _blocks(groups: NDArray[np.intp]) -> list[tuple[int, slice]]:
    """Return the groups of a trial's rows, each a stretch."""
    borders = [0, *(np.flatnonzero(np.diff(groups)) + 1).tolist(), len(groups)]
    return [(int(groups[first]), slice(first, last)) for first, last in pairwise(borders) if last > first]
