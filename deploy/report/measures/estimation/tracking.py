"""The summary's ``accuracy``: scores of all estimators against the recorded arm, on the same ticks."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Hand
from tis.common.metrics.consistency import consistency, normalised_squares
from tis.common.metrics.percentiles import summarise
from tis.common.metrics.tracking import SETTLING_NS, Scorable, score, scored_ticks, truth_at
from tis.common.records import ESTIMATES, PLANT, TRUTH
from tis.common.scenario import Scenario
from tis.common.scenario.estimator_names import plain_name
from tis.common.units import NS_PER_US, sample_index
from tis.deploy.logs.coverage import lies_in
from tis.deploy.logs.read.load import Ints, RunLogs
from tis.deploy.logs.read.note_columns import notes, place_in
from tis.deploy.report.measures.estimation.offsets import offsets
from tis.patient_side.statespace import ArmModel

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


def track_of_hand(logs: RunLogs, scenario: Scenario, hand: Hand) -> HandTrack:
    """Return one hand's track as far as its logs reach, at the ticks of hold, which always runs."""
    sample_ns, recorded_m = _truth(logs, hand)
    names = _estimators(logs, scenario)
    by_name = {name: notes(logs, "patient", topic_of(name)) for name in names}
    reference = by_name.get("hold", notes(logs, "patient", f"{ESTIMATES}/hold"))
    ours = reference.where("hand", hand)
    # no estimates: the recorded samples stand in for ticks, so that the truth can be drawn
    if not ours.any():
        truth_m = truth_at(sample_ns, sample_ns, recorded_m)
        none = np.zeros(len(sample_ns), dtype=np.bool_)
        return HandTrack(sample_ns, np.arange(len(sample_ns)), truth_m, {}, none, {})
    t_ns, tick = reference.column("t_ns")[ours], reference.column("tick")[ours]
    truth_m = _known_truth(logs, t_ns, truth_at(t_ns, sample_ns, recorded_m))
    estimates, stds = {}, {}
    for name, rows in by_name.items():
        which, of = rows.where("hand", hand), rows.column("tick")
        estimates[name] = at_ticks(tick, of[which], rows.column("position_m")[which])
        stds[name] = at_ticks(tick, of[which], rows.column("std_m")[which])
    arrivals = logs.messages("patient", "forward", scenario.session)
    first_ns = min((int(columns.log_ns.min()) for columns in arrivals.values()), default=None)
    scored = scored_ticks(t_ns, truth_m, estimates["hold"], first_ns)
    # after a time that is left out filters settle again, as at the beginning
    scored &= ~lies_in(t_ns, logs.left_out, 0, SETTLING_NS)
    if scenario.patient.plant.kind != "replay":
        moved = notes(logs, "patient", PLANT)
        which = moved.where("hand", hand)
        estimates["plant"] = at_ticks(tick, moved.column("tick")[which], moved.column("position_m")[which])
    return HandTrack(t_ns, tick, truth_m, estimates, scored, stds)


def accuracy_of_hand(logs: RunLogs, scenario: Scenario, hand: Hand, model: ArmModel) -> dict[str, Any]:
    """Return the scores of all estimators for one hand, and of an arm that executes set points."""
    return accuracy_of_track(logs, scenario, track_of_hand(logs, scenario, hand), model)


def accuracy_of_track(logs: RunLogs, scenario: Scenario, track: HandTrack, model: ArmModel) -> dict[str, Any]:
    """Return the scores of one hand's track; empty where truth or estimates are missing."""
    return pooled_accuracy(logs, scenario, [(track, model)])


def pooled_accuracy(logs: RunLogs, scenario: Scenario, hands: Sequence[tuple[HandTrack, ArmModel]]) -> dict[str, Any]:
    """Return the scores of all estimators, pooled over hands; empty where truth or estimates are missing.

    ``nees`` is of errors against the truth; ``nis`` uses only ticks between two samples that reached the patient,
    where the filter itself could check its innovation. Both are `tis.common.metrics.consistency` of the estimators
    that state a deviation. ``offset`` is from `tis.deploy.report.measures.estimation.offsets`.
    """
    known = [(t, m) for t, m in hands if "hold" in t.estimates and np.isfinite(t.truth_m).any()]
    arrived = [_samples_arrived(logs, scenario, track, model) for track, model in known]
    names = dict.fromkeys(name for track, _ in known for name in track.estimates)
    result: dict[str, Any] = {}
    for name in names:
        having = [(track, model, both) for (track, model), both in zip(known, arrived, strict=True)
                  if name in track.estimates]  # fmt: skip
        entry: dict[str, Any] = dict(score(*(_scorable(track, model, name) for track, model, _ in having)))
        entry["offset"] = offsets([track for track, _, _ in having], name, scenario.rate_hz)
        if name != "plant":
            entry |= _steps_and_deviations(logs, name, having)
        else:
            entry["clamped_pct"] = _clamped_pct(logs, [model for _, model, _ in having])
        result[name] = entry
    return result


def _scorable(track: HandTrack, model: ArmModel, name: str) -> Scorable:
    range_m = model.output_high_m - model.output_low_m
    return Scorable(track.estimates[name], track.estimates["hold"], track.truth_m, track.scored, range_m)


def _steps_and_deviations(
    logs: RunLogs, name: str, hands: Sequence[tuple[HandTrack, ArmModel, NDArray[np.bool_]]]
) -> dict[str, Any]:
    """Return the times of an estimator's steps, and its consistency where it states deviations."""
    rows = notes(logs, "patient", topic_of(name))
    steps_ns = rows.column("step_ns")[np.any([rows.where("hand", model.hand) for _, model, _ in hands], axis=0)]
    # virtual time logs 0 for every step: no measurement
    measured = steps_ns if steps_ns.any() else steps_ns[:0]
    entry: dict[str, Any] = {"step_us": summarise(measured / NS_PER_US, percentiles=(50, 99), also=())}
    if any(np.isfinite(track.stds[name][track.scored]).any() for track, _, _ in hands):
        errors, innovations = [], []
        for track, _, arrived in hands:
            squares = normalised_squares(track.estimates[name] - track.truth_m, track.stds[name])
            errors.append(squares[track.scored])
            innovations.append(squares[track.scored & arrived])
        entry["nees"] = consistency(np.concatenate(errors))
        entry["nis"] = consistency(np.concatenate(innovations))
    return entry


def _clamped_pct(logs: RunLogs, models: Sequence[ArmModel]) -> float | None:
    """Return the share of the hands' ticks whose set point lay outside what the arm's joints reach, in %."""
    rows = notes(logs, "patient", PLANT)
    which = np.any([rows.where("hand", model.hand) for model in models], axis=0)
    clamped = rows.column("clamped")[which]
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


def _truth(logs: RunLogs, hand: Hand) -> tuple[Ints, Array]:
    """Return the sample instants (N,), ascending, and the arm's positions (N, 3)."""
    rows = notes(logs, "surgeon", TRUTH)
    ours = rows.where("hand", hand)
    sample_ns, position_m = rows.column("sample_ns")[ours], rows.column("position_m")[ours]
    # a surgeon that came back logs the samples before its return again
    sample_ns, first = np.unique(sample_ns, return_index=True)
    return sample_ns, position_m[first]


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


def _estimators(logs: RunLogs, scenario: Scenario) -> list[str]:
    log, prefix = logs.sides.get("patient"), f"{ESTIMATES}/"
    topics = () if log is None else sorted(log.rows)
    called = {plain_name(name): name for name in scenario.estimators}
    plain = [topic.removeprefix(prefix) for topic in topics if topic.startswith(prefix)]
    return _in_order([called.get(name, name) for name in plain], scenario)


def _in_order(names: list[str], scenario: Scenario) -> list[str]:
    requested = [name for name in scenario.estimators if name in names]
    return requested + [name for name in names if name not in requested]


def at_ticks(ticks: Ints, of: Ints, points: Array) -> Array:
    """Return the points (T, ...) of ``ticks`` (T,) from ``points`` (N, ...) of the ticks ``of`` (N,); else NaN."""
    # estimators may miss ticks or log them out of order
    order = np.argsort(of, kind="stable")
    place, known = place_in(of[order], ticks)
    found = np.full((len(ticks), *points.shape[1:]), np.nan)
    found[known] = points[order[place[known]]]
    return found
