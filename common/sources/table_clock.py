"""The clock of a table's rows: their rate, their gaps, and the instants that a run plays."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from typing import Final, Literal

import numpy as np

from tis.common.errors import MAX_SHOWN, Fault, capped
from tis.common.scenario.table_source import MAX_RESAMPLED
from tis.common.sources.plausibility import RATES_HZ
from tis.common.sources.table_columns import MAX_ROWS
from tis.common.sources.trajectory import Array

SECONDS_PER: Final = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}

_GAP_PERIODS: Final = 1.8  # one row that is missing leaves 2 periods
_RATE_TOLERANCE: Final = 0.005
_ON_GRID_S: Final = 1e-6
_AROUND: Final = (-2, -1, 1, 2)
_FEWEST_TOLD: Final = 50
_CLEARLY_SMOOTHER: Final = 0.9
_MOST_RAISED: Final = 4.0  # more rows between two recorded ones are a straight line's, and no movement


@dataclass(frozen=True)
class RowClock:
    """Times (N,) of the rows in s, from the first one, their rate, and the gaps as rows before them."""

    t_s: Array
    found_hz: float
    gaps: tuple[int, ...]

    def gaps_in_words(self) -> str:
        """Return number, place and length of the gaps."""
        lengths_s = [self.t_s[row + 1] - self.t_s[row] for row in self.gaps]
        shown = ", ".join(
            f"{self.t_s[row]:.3f} s (row {row}; {1e3 * length:.0f} ms)"
            for row, length in list(zip(self.gaps, lengths_s, strict=True))[:3]
        )
        rest = f" and {len(self.gaps) - 3} more" if len(self.gaps) > 3 else ""
        return f"{len(self.gaps)} {'gap' if len(self.gaps) == 1 else 'gaps'}, after {shown}{rest}"


@dataclass(frozen=True)
class Played:
    """Instants (M,) in s at which rows are interpolated, None where they are played as they are, and warnings."""

    at_s: Array | None
    warnings: tuple[str, ...] = ()


def row_clock(t_s: Array, where: str, column: str) -> tuple[RowClock | None, list[Fault]]:
    """Return the clock of finite times (N,) in s, N >= 2, or the faults of times that repeat or go back.

    The rate is that of the rows without the gaps; a gap is a step of 1.8 times the median or more. Oracle: grids
    with rows cut out, test_table_clock.
    """
    steps_s = np.diff(t_s)
    bad = np.flatnonzero(steps_s <= 0.0)
    if bad.size:
        rule = f"must be later than the row before (column {column}): sort the rows, or leave repeated ones out"
        found = [
            Fault(where, f"row {i + 1}", rule, f"{t_s[i + 1]:.9g} s after {t_s[i]:.9g} s") for i in bad[:MAX_SHOWN]
        ]
        return None, capped(found, len(bad), where, rule)
    long = steps_s > _GAP_PERIODS * float(np.median(steps_s))
    found_hz = 1.0 / float(steps_s[~long].mean())
    return RowClock(t_s - t_s[0], found_hz, tuple(int(i) for i in np.flatnonzero(long))), []


def played(
    clock: RowClock, rate_hz: int, resample: Literal["auto"] | bool | float, gaps: Literal["refuse", "bridge"],
    where: str, time_unit: str | None = None, smoother: bool = False,
) -> tuple[Played, list[Fault]]:  # fmt: skip
    """Return the instants that a run at ``rate_hz`` plays, or the faults of gaps and of another rate.

    Rows on the grid of ``rate_hz`` are played as they are. ``resample`` interpolates others: True where the rate is
    that of a recorder, and raised four times at most; a number where it is raised so many times at most; auto where
    their paths are ``smoother`` at their uneven times. Rows that are counted have no ``time_unit``. Oracle:
    test_table_clock.
    """
    at_most = 0.0 if resample == "auto" else float(resample)
    faults = [_not_bridged(clock, where)] if clock.gaps and gaps == "refuse" else []
    warnings = []
    if clock.gaps and not faults:
        done = "interpolated" if at_most else "played without the time that is missing"
        warnings.append(f"{clock.gaps_in_words()}: {done}")
    grid_s = np.arange(len(clock.t_s)) / rate_hz
    off_s = float(np.abs(clock.t_s - grid_s).max())
    if off_s <= _ON_GRID_S:
        return Played(None, tuple(warnings)), faults
    other = rate_hz / clock.found_hz
    likely, question = other_unit(clock.found_hz, float(clock.t_s[-1]), time_unit)
    usual = not likely and other <= _MOST_RAISED * (1.0 + _RATE_TOLERANCE)
    n = int(np.floor(clock.t_s[-1] * rate_hz + 1e-6)) + 1
    is_near = abs(other - 1.0) <= _RATE_TOLERANCE
    if resample == "auto" and smoother and is_near and not clock.gaps:
        warnings.append(
            f"its times depart from {rate_hz} rows a second by up to {_ms(off_s)} ms, and paths are smoother at them "
            "than at even times: rows are interpolated (source.resample: false plays them evenly)"
        )
        return Played(np.minimum(np.arange(n) / rate_hz, clock.t_s[-1]), tuple(warnings)), faults
    if usual if resample is True else other <= at_most * (1.0 + _RATE_TOLERANCE):
        if n > MAX_ROWS:
            return Played(None), [*faults, Fault(where, "", f"must have at most {MAX_ROWS} rows at {rate_hz} Hz", n)]
        about = f"resampled from {clock.found_hz:.6g} rows a second to {rate_hz}: positions and angles linearly"
        warnings.append(f"{about}, orientations along great arcs")
        return Played(np.minimum(np.arange(n) / rate_hz, clock.t_s[-1]), tuple(warnings)), faults
    if at_most or not is_near:
        raised = max(1, ceil(other - 1e-6 * other))
        nearest = round(clock.found_hz)
        is_whole = not likely and abs(clock.found_hz / max(nearest, 1) - 1.0) <= _RATE_TOLERANCE
        choices = [f"rate_hz: {nearest}"] if is_whole else []
        if n <= MAX_ROWS and raised <= MAX_RESAMPLED:  # else it would be refused in turn
            few = "" if other <= _MOST_RAISED else f", {raised} from each recorded one"
            choices.append(f"source.resample: {'true' if usual else raised} to interpolate rows at {rate_hz} Hz{few}")
        rule = f"has {clock.found_hz:.6g} rows a second and the scenario's rate_hz is {rate_hz}: "
        rule += f"{question} Then set source.columns.time and source.units.time: {likely}" if likely else ""
        rule += "; else " if likely and choices else ""
        rule += f"set {', or '.join(choices)}" if choices else ""
        return Played(None), [*faults, Fault(where, "", rule)]
    if not clock.gaps and off_s > 0.5 / rate_hz:
        warnings.append(
            f"its times depart from {rate_hz} rows a second by up to {_ms(off_s)} ms; rows are played evenly "
            "(source.resample: true interpolates them)"
        )
    return Played(None, tuple(warnings)), faults


def _not_bridged(clock: RowClock, where: str) -> Fault:
    rule = (
        "cut the table at them into files of one folder, and compare on these: tis compare --trials "
        "me_1.csv,me_2.csv; or set source.gaps: bridge to play over them"
    )
    return Fault(where, "", f"has {clock.gaps_in_words()}: {rule}")


def _ms(s: float) -> str:
    return f"{1e3 * s:.0f}" if s >= 0.01 else f"{1e3 * s:.2g}"


def smoother_at(t_s: Array, paths: Sequence[Array]) -> bool:
    """Tell whether paths (N, 3) are clearly smoother at times (N,) than at even ones: then the times are their own.

    Each row of the faster half is told from two on either side, by the cubic through them. A recorder that stamps
    what it receives adds its own jitter to even samples; at such times a path is rougher. Oracle: one movement with
    rows at jittering times, and with jittering times at even rows, test_table_clock.
    """
    steps_s = np.diff(t_s)
    if len(t_s) < _FEWEST_TOLD or float(np.ptp(steps_s)) <= _ON_GRID_S:  # even times need no look at the paths
        return False
    usual_s = float(np.median(steps_s))
    around = np.stack([t_s[2 + k : len(t_s) - 2 + k] - t_s[2:-2] for k in _AROUND], axis=1)
    even = np.broadcast_to(np.array(_AROUND) * usual_s, around.shape)
    whole = np.abs(np.diff(around, axis=1)).max(axis=1) < 2.0 * _GAP_PERIODS * usual_s
    ratios = []
    for path in paths:
        speeds = np.linalg.norm(path[3:-1] - path[1:-3], axis=1)
        fast = whole & (speeds > 0.0) & (speeds >= np.median(speeds))
        if fast.any():
            at_times, at_even = (np.median(_misses(path, times)[fast]) for times in (around, even))
            ratios.append(at_times / at_even if at_even > 0.0 else 1.0)
    return bool(ratios) and float(np.mean(ratios)) < _CLEARLY_SMOOTHER


def _misses(path: Array, around_s: Array) -> Array:
    """Return how far rows (N - 4,) lie from the cubics through two rows on either side, at times (N - 4, 4)."""
    told = np.zeros((len(around_s), path.shape[1]))
    for i, k in enumerate(_AROUND):
        others = [around_s[:, j] for j in range(len(_AROUND)) if j != i]
        weight = np.prod([-other / (around_s[:, i] - other) for other in others], axis=0)
        told += weight[:, None] * path[2 + k : len(path) - 2 + k]
    return np.asarray(np.linalg.norm(path[2:-2] - told, axis=1))


def other_unit(found_hz: float, span_s: float, unit: str | None) -> tuple[str, str]:
    """Return the likely unit of times, and it as a question, where ``unit`` gives no recorder's rate; else "", "".

    Times of ``unit`` give ``found_hz`` rows a second over ``span_s``; rows that are counted have none. Oracle: one
    clock in every unit, test_table_clock.
    """
    if unit is None or RATES_HZ[0] <= found_hz <= RATES_HZ[1]:
        return "", ""
    for other, seconds in SECONDS_PER.items():
        factor = seconds / SECONDS_PER[unit]
        if RATES_HZ[0] <= found_hz / factor <= RATES_HZ[1]:
            about = f"{found_hz / factor:.6g} rows a second over {span_s * factor:.4g} s instead of {span_s:.4g} s"
            return other, f"are its times in {other} ({about})?"
    return "", ""
