"""Accuracy of the estimators: scores against the recorded arm, on the same ticks, beside those of hold."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Hand
from tis.common.errors import problem
from tis.common.metrics.consistency import consistency, normalised_squares
from tis.common.metrics.percentiles import summarise
from tis.common.metrics.tracking import Scorable, score
from tis.common.records import PLANT
from tis.common.scenario import Scenario
from tis.common.units import NS_PER_MS, NS_PER_S, NS_PER_US, sample_index
from tis.deploy.logs.read.columns import Ints, joined
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.present.numbers import broken_name, interval, number, percent
from tis.deploy.present.page import css, folded
from tis.deploy.present.palette import Look, look_of
from tis.deploy.present.table import Cell, Column, Table
from tis.deploy.report.section import Section, Statistics, means, statistics
from tis.deploy.report.subjects.own_estimators import OwnEstimator
from tis.deploy.report.subjects.tracking import HandTrack, Offset, offsets, topic_of
from tis.patient_side.statespace import ArmModel


class Consistency(Section):
    """Whether a filter states its own error correctly; a list has an entry for each axis."""

    n: int = means("Errors in use.")
    mean: list[float | None] = means("Mean of (error / stated deviation)\u00b2; 1 for a consistent filter.")
    bounds_95: list[list[float | None] | None] = means(
        "Bounds within which the mean of a consistent filter lies in 95 % of cases."
    )
    consistent: list[bool | None] = means("True for an axis whose mean lies within these bounds.")
    coverage_pct: list[float | None] = means("Errors within 1.96 stated deviations; 95 for a consistent filter.")
    coverage_pct_interval_95: list[list[float | None] | None] = means("95 % confidence interval of the coverage.")


class Scores(Section):
    """The scores of an estimator; `plant` is an arm that executes set points."""

    r2_pct: list[float | None] = means("100 (1 - SSE/SST) along x, y, z, with SST about the scored mean.")
    nrmse_fit_pct: list[float | None] = means("100 (1 - sqrt(SSE/SST)) along x, y, z.")
    rmse_normalized: list[float | None] = means("RMSE along x, y, z over the range of the training rows.")
    rmse_mm: list[float | None] = means("Root mean square error along x, y, z.")
    max_mm: list[float | None] = means("Largest absolute error along x, y, z.")
    r2_3d_pct: float | None = means("100 (1 - SSE/SST), pooled over the axes.")
    nrmse_fit_3d_pct: float | None = means("100 (1 - sqrt(SSE/SST)), pooled over the axes.")
    rmse_3d_mm: float | None = means(
        "Root mean square of the distance to the truth, over the scored ticks of all hands."
    )
    max_3d_mm: float | None = means("Largest distance to the truth.")
    ratio_to_hold: float | None = means(
        "Its error over that of `hold`, sqrt(\u03a3|e|\u00b2 / \u03a3|e_hold|\u00b2); below 1 is better than `hold`."
    )
    n_scored: int = means("Scored ticks, the same for all estimators; they begin 2 s after the first arrival.")
    n_missing: int = means(
        "Scored ticks without an estimate; they count with the error of `hold`, unless an own estimator failed at "
        "each."
    )
    offset: Offset = means("Offsets in time and value.")
    step_us: Statistics = statistics("Computing time of a step; `null` in virtual time.", "p50 p99", default={})
    nees: Consistency | None = means(
        "Of the errors against the truth (normalised estimation error squared).", default=None
    )
    nis: Consistency | None = means(
        "Of the innovations, against samples not yet seen (normalised innovation squared).", default=None
    )
    clamped_pct: float | None = means(
        "Of `plant`: ticks whose set point in force lay outside what the arm's joints reach.", default=None
    )
    failed: bool = means(
        "True for an own estimator that failed in some step, or gave no estimate at over 1 % of the scored ticks.",
        default=False,
    )

    @property
    def without_answer(self) -> bool:
        """Tell whether it has no score, as it failed and gave no estimate at any scored tick."""
        return self.rmse_3d_mm is None and 0 < self.n_scored == self.n_missing

    def label(self, name: str) -> str:
        """Return the estimator's name for tables, with a star if it failed in some step."""
        return f"{name}{' failed' if self.without_answer else ' *' if self.failed else ''}"


_NO_SCORE: Final[Mapping[str, Any]] = {
    **{key: [None] * 3 for key in ("r2_pct", "nrmse_fit_pct", "rmse_normalized", "rmse_mm", "max_mm")},
    **dict.fromkeys(("r2_3d_pct", "nrmse_fit_3d_pct", "rmse_3d_mm", "max_3d_mm", "ratio_to_hold")),
}
_NAME_WIDTH: Final = 17
MAX_WITHOUT_ESTIMATE: Final = 0.01
_MAX_BAR: Final = 3
_CUT: Final = "\u00bb"


def pooled_accuracy(
    logs: RunLogs, scenario: Scenario, hands: Sequence[tuple[HandTrack, ArmModel]]
) -> dict[str, Scores]:
    """Return the scores of all estimators, pooled over hands; empty where truth or estimates are missing.

    ``nees`` is of errors against the truth; ``nis`` uses only ticks between two samples that reached the patient,
    where the filter itself could check its innovation. Both are `tis.common.metrics.consistency` of the estimators
    that state a deviation.
    """
    known = [(t, m) for t, m in hands if "hold" in t.estimates and np.isfinite(t.truth_m).any()]
    arrived = [_samples_arrived(logs, scenario, track, model) for track, model in known]
    names = dict.fromkeys(name for track, _ in known for name in track.estimates)
    result: dict[str, Scores] = {}
    for name in names:
        having = [(track, model, both) for (track, model), both in zip(known, arrived, strict=True)
                  if name in track.estimates]  # fmt: skip
        hands_of = (
            Scorable(t.estimates[name], t.estimates["hold"], t.truth_m, t.scored, m.output_high_m - m.output_low_m)
            for t, m, _ in having
        )
        entry: dict[str, Any] = dict(score(*hands_of))
        entry["offset"] = offsets([track for track, _, _ in having], name, scenario.rate_hz)
        if name != "plant":
            entry |= _steps_and_deviations(logs, name, having)
        else:
            entry["clamped_pct"] = _clamped_pct(logs, [model for _, model, _ in having])
        result[name] = Scores(**entry)
    return result


def _steps_and_deviations(
    logs: RunLogs, name: str, hands: Sequence[tuple[HandTrack, ArmModel, NDArray[np.bool_]]]
) -> dict[str, Any]:
    """Return the times of an estimator's steps, and its consistency where it states deviations."""
    steps_ns = joined(logs.of_hand("patient", topic_of(name), model.hand).step_ns for _, model, _ in hands)
    entry: dict[str, Any] = {"step_us": step_times_us(steps_ns)}
    if any(np.isfinite(track.stds[name][track.scored]).any() for track, _, _ in hands):
        errors, innovations = [], []
        for track, _, arrived in hands:
            squares = normalised_squares(track.estimates[name] - track.truth_m, track.stds[name])
            errors.append(squares[track.scored])
            innovations.append(squares[track.scored & arrived])
        entry["nees"] = consistency(np.concatenate(errors))
        entry["nis"] = consistency(np.concatenate(innovations))
    return entry


def step_times_us(steps_ns: Ints) -> Statistics:
    """Return the computing times of steps (N,); unknown in virtual time, which logs 0 for every step."""
    measured = steps_ns if steps_ns.any() else steps_ns[:0]
    return summarise(measured / NS_PER_US, percentiles=(50, 99), also=())


def _clamped_pct(logs: RunLogs, models: Sequence[ArmModel]) -> float | None:
    """Return the share of the hands' ticks whose set point lay outside what the arm's joints reach, in %."""
    clamped = joined((logs.of_hand("patient", PLANT, model.hand).clamped for model in models), np.bool_)
    return 100.0 * float(np.mean(clamped)) if len(clamped) else None


def _samples_arrived(logs: RunLogs, scenario: Scenario, track: HandTrack, model: ArmModel) -> NDArray[np.bool_]:
    """Mark the ticks (T,) between two consecutive samples of the arm that both reached the patient."""
    rate_hz = scenario.rate_hz
    arrivals = logs.messages("patient", "forward", scenario.session)
    key = f"{scenario.session}/{model.arm}/setpoint_cp"
    instants = arrivals[key].sample_ns if key in arrivals else np.empty(0, dtype=np.int64)
    clock = logs.clocks.model("surgeon")  # samples are evenly spaced on this clock only
    indices = np.unique([sample_index(ns, rate_hz) for ns in clock.from_reference_ns(instants).tolist()])
    # index of the last sample at or before each tick: the inverse of floor(i * 10^9 / rate), exact in integers
    before = ((clock.from_reference_ns(track.t_ns) + 1) * rate_hz - 1) // 1_000_000_000
    return np.isin(before, indices) & np.isin(before + 1, indices)


def with_failures(scores: Mapping[str, Scores], own: Mapping[str, OwnEstimator]) -> dict[str, Scores]:
    """Return the scores, marked where a user-defined estimator failed or did not; without any answer it has none."""
    return {name: _marked(one, own[name].failed) if name in own else one for name, one in scores.items()}


def _marked(scores: Scores, failed: bool) -> Scores:
    never = failed and 0 < scores.n_scored == scores.n_missing
    starred = failed or _often_missing(scores)
    return scores.model_copy(update={"failed": starred, **(_NO_SCORE if never else {})})


def _often_missing(scores: Scores) -> bool:
    return scores.n_missing > MAX_WITHOUT_ESTIMATE * scores.n_scored


def silent_texts(accuracy: Mapping[str, Scores], active: str, own: Mapping[str, OwnEstimator]) -> list[str]:
    """Return a line for each estimator, but the active one, that did not fail and yet often gave no estimate."""
    return [
        f"* {name} gave no estimate at {one.n_missing} of {one.n_scored} scored ticks, where hold's is scored in its "
        "place"
        for name, one in accuracy.items()
        if name != active and name in own and not own[name].failed and _often_missing(one)
    ]


def is_scored(accuracy: Mapping[str, Scores]) -> bool:
    """Tell whether any tick could be scored."""
    return any(entry.n_scored for entry in accuracy.values())


def without_estimate(accuracy: Mapping[str, Scores], active: str, own: Mapping[str, OwnEstimator]) -> list[str]:
    """Return a problem for each estimator that failed throughout, and when the active one often had no estimate."""
    failed = [name for name, entry in accuracy.items() if entry.without_answer]
    problems = []
    for name in failed:
        first = own[name].first_fault
        why = "" if first is None else f": {first.reason}"
        text = f"accuracy: {name} failed at every scored tick, and has no score{why}"
        problems.append(problem(text, "mend the line that it names"))
    entry = accuracy.get(active)
    if entry is None or active in failed or not _often_missing(entry):
        return problems
    of = f"{entry.n_missing} of {entry.n_scored} scored ticks"
    text = f"accuracy: {active} gave no estimate at {of}, where hold's is scored"
    return [*problems, problem(text, "the report has its first failure")]


def slow_estimators(accuracy: Mapping[str, Scores], n_hands: int, rate_hz: int) -> str:
    """Return that the estimators' steps take longer than a tick, and which takes longest; "" where they do not.

    That is at the median of all together, or of one alone in a hundredth of its steps, which no other one needs.
    """
    tick_us = NS_PER_S / NS_PER_US / rate_hz
    medians, highs = (
        {name: n_hands * us for name, one in accuracy.items() if (us := one.step_us.get(which)) is not None}
        for which in ("p50", "p99")
    )
    if not medians:
        return ""
    if sum(medians.values()) > tick_us:
        slowest, when = max(medians, key=medians.__getitem__), "at the median"
        takes_us = medians[slowest]
    else:
        slowest, *others = sorted(highs, key=highs.__getitem__, reverse=True)
        takes_us, when = highs[slowest], "at one in a hundred"
        if takes_us <= tick_us or (others and highs[others[0]] > takes_us / 2):  # a busy machine slows all
            return ""
    takes_ms, tick_ms = takes_us * NS_PER_US / NS_PER_MS, tick_us * NS_PER_US / NS_PER_MS
    all_ms = sum(medians.values()) * NS_PER_US / NS_PER_MS
    of_all = "" if takes_ms > tick_ms else f", of {number(all_ms)} ms of all,"
    return f"as {slowest} takes {number(takes_ms)} ms a step{of_all} {when}, and a tick lasts {number(tick_ms)} ms"


def accuracy_table(accuracy: Mapping[str, Scores], which: str, active: str) -> Table:
    """Return one hand's estimators beside hold, with the error as a bar on the page.

    Bars end at `_MAX_BAR` times hold's error, so that one very bad estimator does not shorten all others; longer bars
    are cut, marked and explained in a note.
    """
    errors = {name: entry.rmse_3d_mm for name, entry in accuracy.items() if entry.rmse_3d_mm is not None}
    largest = max(errors.values(), default=0.0) or 1.0
    longest = min(largest, _MAX_BAR * errors["hold"]) if errors.get("hold") else largest
    # virtual time has no times of steps
    timed = any(entry.step_us.get("p50") is not None for entry in accuracy.values())
    rows = [
        (
            _name(entry.label(name)),
            _with_bar(entry.rmse_3d_mm, longest, look_of(name, list(accuracy))),
            percent(entry.ratio_to_hold, fine=True),
            *entry.r2_pct,
            entry.n_scored,
            entry.n_missing,
            *((entry.step_us.get("p50"), entry.step_us.get("p99")) if timed else ()),
        )
        for name, entry in accuracy.items()
    ]
    steps = (Column("step, median", "\u00b5s", short="\u00b5s"), Column("step, p99", "\u00b5s", short="p99"))
    columns: tuple[Column | str, ...] = (
        "estimator", Column("RMSE in 3D", "mm", short="RMSE mm"),
        Column("share of hold's error", "%", short="% hold"), Column("R\u00b2 x", "%", short="R\u00b2 % x"),
        Column("R\u00b2 y", "%", short="y"), Column("R\u00b2 z", "%", short="z"),
        Column("ticks", on_page_only=True), Column("missing", on_page_only=True), *(steps if timed else ()),
    )  # fmt: skip
    note = f"Bars end at {_MAX_BAR} times hold's error; longer ones are cut ({_CUT})" if largest > longest else ""
    marked = _name(accuracy[active].label(active)) if active in accuracy else active
    return Table(f"Accuracy at the tick, {which}", columns, rows, note, marked)


def _name(label: str) -> Cell:
    """Return an estimator's name, which may break in the lines of its cell."""
    return Cell(broken_name(label, _NAME_WIDTH), markup=escape(label).replace(":", ":<wbr>"))


def _with_bar(value: float | None, longest: float, look: Look) -> Cell:
    """Return a number with a bar in the estimator's colour, which is hidden from screen readers."""
    text = f"{_CUT} {number(value)}" if value is not None and value > longest else number(value)
    share = 0.0 if value is None else min(100 * value / longest, 100.0)
    bar = f'<i style="width:{share:.1f}%"></i>'
    return Cell(
        text, markup=f'{text}<span class="bar" aria-hidden="true" style="color:{css(look.tone)}">{bar}</span>'
    )


def more_accuracy(by_hand: Mapping[Hand, Mapping[str, Scores]], active: str) -> str:
    """Return a folded section: largest errors, time and value offsets and consistency of each hand."""
    each = [
        table.html() * bool(table.rows)
        for hand, accuracy in by_hand.items()
        for table in (_offsets(accuracy, f"{hand} hand", active), _consistency(accuracy, f"{hand} hand"))
    ]
    return folded("More about the accuracy", "".join(each))


def _offsets(accuracy: Mapping[str, Scores], which: str, active: str) -> Table:
    rows = [
        (name, one.max_3d_mm, one.r2_3d_pct, one.nrmse_fit_3d_pct, *late, one.offset.value_rms_mm)
        for name, one in accuracy.items()
        for late in [[one.offset.time_ms[name] for name in ("p50", "p95")]]
    ]
    step_ms = max((one.offset.step_ms for one in accuracy.values()), default=0.0)
    columns: tuple[Column | str, ...] = (
        "estimator", "max error, mm", "R\u00b2 in 3D, %", "fit (NRMSE), %", "late by, median, ms", "late by, p95, ms",
        "wrong beyond that, RMS, mm",
    )  # fmt: skip
    note = (
        "Late by: the shift in time that explains most of the error at each instant (effective time offset), in "
        f"steps of {number(step_ms)} ms; the rest is an error in value"
    )
    return Table(f"Errors and offsets, {which}", columns, rows, note, active)


def _consistency(accuracy: Mapping[str, Scores], which: str) -> Table:
    rows = [
        (
            f"{name}, {kind} {axis}",
            found.mean[i],
            interval(found.bounds_95[i]),
            found.coverage_pct[i],
            interval(found.coverage_pct_interval_95[i]),
            found.consistent[i],
        )
        for name, entry in accuracy.items()
        for kind, found in (("NEES", entry.nees), ("NIS", entry.nis))
        if found is not None and found.n
        for i, axis in enumerate("xyz")
    ]
    bounds = ("its 95 % bounds", "in the 95 % interval, %", "its interval, %")
    columns = ("filter", "mean, should be 1", *bounds, Column("consistent", words=True))
    note = (
        "Does the filter state its own error correctly? Above 1 it is overconfident, below 1 underconfident. "
        "NEES: its errors, NIS: its innovations, each in units of its own variance"
    )
    return Table(f"Consistency, {which}", columns, rows, note)
