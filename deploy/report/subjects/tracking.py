"""Tracks of the arm: truth and estimates of one hand, tick by tick."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Hand
from tis.common.metrics.tracking import SETTLING_NS, scored_ticks, truth_at
from tis.common.records import ESTIMATES, PLANT, TRUTH
from tis.common.scenario import Scenario
from tis.common.scenario.estimator_names import plain_name
from tis.deploy.logs.coverage import lies_in
from tis.deploy.logs.read.load import Ints, RunLogs
from tis.deploy.logs.read.note_columns import notes, place_in

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
