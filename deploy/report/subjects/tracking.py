"""Tracks of the arm, truth and estimates of one hand by tick; errors by age, and offsets in time and value (ETVO)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Hand
from tis.common.metrics.etvo import Etvo, etvo, finer_grid_s, offset_grid_s
from tis.common.metrics.percentiles import summarise
from tis.common.metrics.tracking import SETTLING_NS, scored_ticks, truth_at
from tis.common.records import ESTIMATES, PLANT, TRUTH
from tis.common.scenario import Scenario
from tis.common.scenario.estimator_names import plain_name
from tis.common.units import MM_PER_M, NS_PER_S
from tis.deploy.logs.coverage import lies_in
from tis.deploy.logs.read.columns import Ints
from tis.deploy.logs.read.frame import Frame
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.packets import place_in
from tis.deploy.report.section import Section, Statistics, means, statistics
from tis.deploy.report.subjects.age import ages_at_ms

Array = NDArray[np.float64]


@dataclass(frozen=True)
class HandTrack:
    """Truth and estimates of one hand by tick; positions (T, 3) in m, NaN for none.

    ``estimates`` begins with the scenario's estimators in its order; the arm that executes set points comes last, as
    ``plant``. ``stds`` (T, 3) are the standard deviations that estimators state, NaN for none. ``scored`` (T,) marks
    the scored ticks. Without estimates the instants are those of the recorded samples.
    """

    t_ns: Ints
    tick: Ints
    truth_m: Array
    estimates: dict[str, Array]
    scored: NDArray[np.bool_]
    stds: dict[str, Array]

    @property
    def errors_mm(self) -> dict[str, Array]:
        """Return each estimate's distance to the truth (T,) in mm, NaN for none."""
        return {
            name: MM_PER_M * np.linalg.norm(estimate_m - self.truth_m, axis=1)
            for name, estimate_m in self.estimates.items()
        }


def track_of_hand(logs: RunLogs, scenario: Scenario, hand: Hand) -> HandTrack:
    """Return one hand's track as far as its logs reach, at the ticks of hold, which always runs."""
    # a surgeon that came back logs the samples before its return again
    truth = logs.of_hand("surgeon", TRUTH, hand).first_of_each("sample_ns")
    by_name = {
        name: logs.of_hand("patient", topic_of(name), hand)
        for name in logged_names(logs, ESTIMATES, scenario.estimators)
    }
    hold = by_name.get("hold")
    # no estimates: the recorded samples stand in for ticks, so that the truth can be drawn
    if hold is None or not len(hold):
        truth_m = truth_at(truth.sample_ns, truth.sample_ns, truth.position_m)
        none = np.zeros(len(truth), dtype=np.bool_)
        return HandTrack(truth.sample_ns, np.arange(len(truth)), truth_m, {}, none, {})
    t_ns, tick = hold.t_ns, hold.tick
    truth_m = _known_truth(logs, t_ns, truth_at(t_ns, truth.sample_ns, truth.position_m))
    estimates = {name: at_ticks(tick, rows, "position_m") for name, rows in by_name.items()}
    stds = {name: at_ticks(tick, rows, "std_m") for name, rows in by_name.items()}
    arrivals = logs.messages("patient", "forward", scenario.session)
    first_ns = min((int(columns.log_ns.min()) for columns in arrivals.values()), default=None)
    scored = scored_ticks(t_ns, truth_m, estimates["hold"], first_ns)
    # after a time that is left out filters settle again, as at the beginning
    scored &= ~lies_in(t_ns, logs.left_out, 0, SETTLING_NS)
    if scenario.patient.plant.kind != "replay":
        estimates["plant"] = at_ticks(tick, logs.of_hand("patient", PLANT, hand), "position_m")
    return HandTrack(t_ns, tick, truth_m, estimates, scored, stds)


def _known_truth(logs: RunLogs, t_ns: Ints, truth_m: Array) -> Array:
    """Return the truth (T, 3), NaN where it was interpolated across a gap of the surgeon's log."""
    covered = logs.coverage("surgeon")
    if covered is None or covered.whole:
        return truth_m
    in_gap = lies_in(t_ns, covered.unknown, 0, 0)
    return np.where(in_gap[:, None], np.nan, truth_m)


def topic_of(estimator: str) -> str:
    """Return the topic of an estimator's estimates in the patient's log."""
    return f"{ESTIMATES}/{plain_name(estimator)}"


def logged_names(logs: RunLogs, topic: str, requested: Sequence[str]) -> list[str]:
    """Return the methods that have a topic of their own below ``topic`` in the patient's log, the requested first."""
    log, prefix = logs.sides.get("patient"), f"{topic}/"
    logged = [] if log is None else [one.removeprefix(prefix) for one in sorted(log.rows) if one.startswith(prefix)]
    asked = {plain_name(name): name for name in requested}
    return [name for plain, name in asked.items() if plain in logged] + [one for one in logged if one not in asked]


def at_ticks(ticks: Ints, rows: Frame, name: str) -> Array:
    """Return a field (T, ...) of records by tick at ``ticks`` (T,); NaN for ticks without a record."""
    of, points = rows.column("tick"), rows.column(name)
    # estimators may miss ticks or log them out of order
    order = np.argsort(of, kind="stable")
    place, known = place_in(of[order], ticks)
    found = np.full((len(ticks), *points.shape[1:]), np.nan)
    found[known] = points[order[place[known]]]
    return found


class AgeBins(Section):
    """The error of an estimator in bins of age."""

    age_ms: list[float] = means("Ages of the freshest sample, the middle of each bin.")
    rmse_3d_mm: list[float] = means("RMSE at these ages.")
    n: list[int] = means("Scored ticks in each bin.")


class TurnAgeBins(Section):
    """The error of an orientation method in bins of age."""

    age_ms: list[float] = means("Ages of the freshest sample, the middle of each bin.")
    rms_deg: list[float] = means("RMS of the orientation error at these ages.")
    n: list[int] = means("Scored ticks in each bin.")


MAX_BINS = 14
MIN_TICKS = 10
_STEP_MS = 0.5


class ErrorByAge(NamedTuple):
    """Bins of age, ascending: mean age (B,) in ms, RMSE (B,) in the error's unit, number of ticks (B,)."""

    age_ms: Array
    rmse: Array
    n: NDArray[np.int64]


def error_by_age(age_ms: Array, error: Array) -> ErrorByAge:
    """Return the RMSE by age of T ticks; ``age_ms`` and ``error`` are (T,), NaN for unknown.

    Samples and ticks usually share a rate, so ages take few values. Each value is a bin; rare ones are merged with
    older neighbours up to `MIN_TICKS` ticks. If that makes more than `MAX_BINS` bins, bins hold equal numbers of
    ticks instead. A last bin that stays too small is left out. Oracle: tables computed by hand, test_error_by_age.
    """
    known = np.isfinite(age_ms) & np.isfinite(error)
    age, squared = age_ms[known], error[known] ** 2
    # ages within half a millisecond count as one value
    label = np.round(age / _STEP_MS).astype(np.int64)
    _, place, n = np.unique(label, return_inverse=True, return_counts=True)
    place = _merged_bins(n)[place]
    if len(place) and place.max() >= MAX_BINS + int(np.bincount(place)[-1] < MIN_TICKS):
        # too many values: bins of equal counts; repeated edges would make empty bins
        edges = np.unique(np.quantile(age, np.linspace(0, 1, MAX_BINS + 1)))
        place = np.clip(np.searchsorted(edges, age, side="right") - 1, 0, max(len(edges) - 2, 0))
    n = np.bincount(place)
    total, ages = np.bincount(place, weights=squared), np.bincount(place, weights=age)
    enough = n >= MIN_TICKS
    n, total, ages = n[enough], total[enough], ages[enough]
    return ErrorByAge(ages / n, np.sqrt(total / n), n)


def _merged_bins(n: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the bin (V,) of each of V ascending ages with counts ``n`` (V,); a bin is full at `MIN_TICKS`."""
    bins = np.zeros(len(n), dtype=np.int64)
    current = filled = 0
    for i, count in enumerate(n.tolist()):
        bins[i] = current
        filled += count
        if filled >= MIN_TICKS:
            current, filled = current + 1, 0
    return bins


def errors_by_age(logs: RunLogs, track: HandTrack, hand: Hand) -> dict[str, AgeBins]:
    """Return the summary's ``error_by_age`` of one hand: by estimator, bins of age, their RMSE in 3D and tick counts.

    Bins are those of `error_by_age`; ticks without an estimate are left out. Oracle: test_error_by_age.
    """
    found = scored_by_age(logs, track, hand, track.errors_mm)
    return {
        name: AgeBins(age_ms=bins.age_ms.tolist(), rmse_3d_mm=bins.rmse.tolist(), n=bins.n.tolist())
        for name, bins in found.items()
    }


def scored_by_age(logs: RunLogs, track: HandTrack, hand: Hand, errors: Mapping[str, Array]) -> dict[str, ErrorByAge]:
    """Return the errors by age of the scored ticks, by name; ``errors`` are (T,) of all ticks."""
    age_ms = ages_at_ms(logs, hand, track.t_ns)[track.scored]
    return {name: error_by_age(age_ms, error[track.scored]) for name, error in errors.items()}


class Offset(Section):
    """Effective time and value offsets (ETVO) of the reproduced movement."""

    n: int = means("Ticks that were aligned with the truth: of more than 6000 every second one, or third, ...")
    step_ms: float = means("Time offsets are multiples of this: the finest grid that spans those of the run.")
    time_ms: Statistics = statistics("Effective time offset, positive when the movement is late.", "mean p50 p95 max")
    value_mm: Statistics = statistics(
        "Effective value offset, the error that remains after the time offset.", "p50 p95 max"
    )
    value_rms_mm: float | None = means("Root mean square of the value offset.")
    delay_derivative_ms_per_s: float | None = means("Mean absolute change of the time offset.")


MAX_ALIGNED: Final = 6000
"""Scored ticks that are aligned at most, spread over the run: the cost grows with their number."""
_MIN_OFFSET_S: Final = -0.2
_MAX_OFFSET_S: Final = 1.0
_STEPS_A_TICK: Final = 4
_MS_PER_S: Final = 1000.0


def offsets(tracks: Sequence[HandTrack], name: str, rate_hz: int) -> Offset:
    """Return the offsets of one estimator against the truth, of all hands together.

    Time offsets from -0.2 to 1 s are searched.
    ``time_ms`` is positive for a late estimate, ``value_mm`` the error that remains after the shift in time, and
    ``delay_derivative_ms_per_s`` the rate of change of the delay. Missing estimates are left out.
    """
    found = [aligned(track, track.estimates[name], track.truth_m, rate_hz) for track in tracks]
    rates = [(one.delay_derivative, len(one.time_s) - 1) for one in found]
    known = [(rate, n) for rate, n in rates if rate is not None]
    mean_rate = sum(rate * n for rate, n in known) / sum(n for _, n in known) if known else None
    times_s, values = ([one.time_s for one in found], [one.value for one in found])
    step_s = max(one.step_s for one in found)
    return _offset(Etvo(np.concatenate(times_s), np.concatenate(values), mean_rate, step_s))


def actuation_ms(track: HandTrack, active: str, rate_hz: int, follows: NDArray[np.bool_] | None = None) -> Array:
    """Return the delay (T,) in ms of the plant's arm behind the active estimate; empty where it executes nothing.

    ``follows`` (T,) marks the ticks at which it follows the estimate: an arm that is stopped, or on its way back from
    where it was, is not late. None: at all.
    """
    if "plant" not in track.estimates or active not in track.estimates:
        return np.empty(0)
    if follows is not None:
        track = replace(track, scored=track.scored & follows)
    found = aligned(track, track.estimates["plant"], track.estimates[active], rate_hz)
    return found.time_s * _MS_PER_S


def aligned(
    track: HandTrack, reproduced_m: Array, original_m: Array, rate_hz: int, latest_s: float = _MAX_OFFSET_S
) -> Etvo:
    """Return the offsets of a movement (T, 3) to another at scored ticks that have both.

    Of more than `MAX_ALIGNED` every second one is aligned, or third, and so on, so that they are of the whole run. A
    second search among offsets about those of the first resolves what the first leaves, up to 4.7 ms or a quarter of
    the period.
    """
    known = track.scored & np.isfinite(reproduced_m).all(axis=1) & np.isfinite(original_m).all(axis=1)
    which = np.flatnonzero(known)
    if (original_m[which] == original_m[which[:1]]).all():
        which = which[:0]  # at rest every offset fits
    # four candidate offsets per tick resolve a quarter of the period
    grid_s = offset_grid_s(_MIN_OFFSET_S, latest_s, 1.0 / (_STEPS_A_TICK * rate_hz))
    every = -(-len(which) // MAX_ALIGNED) or 1
    movements = track.t_ns[which] / NS_PER_S, reproduced_m[which], original_m[which]
    found = etvo(*movements, grid_s, every)
    return etvo(*movements, finer_grid_s(grid_s, found.time_s), every) if len(found.time_s) else found


def _offset(found: Etvo) -> Offset:
    value_mm = found.value * MM_PER_M
    derivative = found.delay_derivative
    return Offset(
        n=len(value_mm),
        step_ms=found.step_s * _MS_PER_S,
        time_ms=summarise(found.time_s * _MS_PER_S, (50, 95), ("mean", "max")),
        value_mm=summarise(value_mm, (50, 95), ("max",)),
        value_rms_mm=float(np.sqrt(np.mean(value_mm**2))) if len(value_mm) else None,
        delay_derivative_ms_per_s=None if derivative is None else derivative * _MS_PER_S,
    )
