"""The summary's ``accuracy``: every estimator against the recorded arm, on the same ticks."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.channels import Hand
from common.metrics.percentiles import summarise
from common.metrics.tracking import score, scored_ticks, truth_at
from common.records import ESTIMATES, PLANT, TRUTH
from common.scenario import Scenario
from common.units import NS_PER_US
from deploy.report.load import Row, RunLogs
from patient_side.statespace import ArmModel

Array = NDArray[np.float64]


@dataclass(frozen=True)
class HandTrack:
    """Where one hand's arm was and where each estimator put it, tick by tick; positions (T, 3) in m, NaN where none.

    ``estimates`` begins with the estimators of the scenario, in its order; a servo's arm comes last, as ``plant``.
    ``scored`` (T,) marks the ticks that count. Without estimates the instants are those of the recorded samples.
    """

    t_ns: NDArray[np.int64]
    truth_m: Array
    estimates: dict[str, Array]
    scored: NDArray[np.bool_]


def track_of_hand(logs: RunLogs, scenario: Scenario, hand: Hand) -> HandTrack:
    """Return one hand's track, as far as there are logs of it; the ticks are those of hold, which always runs."""
    truth_rows = _truth_rows(logs, hand)
    names = _estimators(logs, scenario)
    by_name = {name: _estimate_rows(logs, name, hand) for name in names}
    reference = by_name.get("hold", [])
    sample_ns = np.array([row["sample_ns"] for row in truth_rows], dtype=np.int64)
    t_ns = np.array([row["t_ns"] for row in reference], dtype=np.int64) if reference else sample_ns
    truth_m = truth_at(t_ns, sample_ns, _xyz(truth_rows))
    if not reference:
        return HandTrack(t_ns, truth_m, {}, np.zeros(len(t_ns), dtype=np.bool_))
    ticks = [row["tick"] for row in reference]
    estimates = {name: _at({row["tick"]: row for row in rows}, ticks) for name, rows in by_name.items()}
    arrivals = logs.messages("patient", "forward", scenario.session)
    first_ns = min((int(columns.log_ns.min()) for columns in arrivals.values()), default=None)
    scored = scored_ticks(t_ns, truth_m, estimates["hold"], first_ns)
    if scenario.patient.plant.kind == "servo":
        rows = {row["tick"]: row for row in logs.of("patient", PLANT) if row["hand"] == hand}
        estimates["plant"] = _at(rows, ticks)
    return HandTrack(t_ns, truth_m, estimates, scored)


def accuracy_of_hand(logs: RunLogs, scenario: Scenario, hand: Hand, model: ArmModel) -> dict[str, Any]:
    """Return the scores of all estimators for one hand, and of the plant when it is a servo."""
    track = track_of_hand(logs, scenario, hand)
    if "hold" not in track.estimates or not _truth_rows(logs, hand):
        return {}
    hold_m = track.estimates["hold"]
    range_m = model.output_high_m - model.output_low_m
    result: dict[str, Any] = {}
    for name, estimate_m in track.estimates.items():
        result[name] = dict(score(estimate_m, hold_m, track.truth_m, track.scored, range_m))
        if name != "plant":
            steps_ns = np.array([row["step_ns"] for row in _estimate_rows(logs, name, hand)], dtype=np.int64)
            measured = steps_ns if steps_ns.any() else steps_ns[:0]
            result[name]["step_us"] = summarise(measured / NS_PER_US, percentiles=(50, 99), also=())
    return result


def _truth_rows(logs: RunLogs, hand: Hand) -> list[Row]:
    rows = (row for row in logs.of("surgeon", TRUTH) if row["hand"] == hand)
    return sorted(rows, key=lambda row: row["sample_ns"])


def _estimate_rows(logs: RunLogs, name: str, hand: Hand) -> list[Row]:
    return [row for row in logs.of("patient", f"{ESTIMATES}/{name}") if row["hand"] == hand]


def _estimators(logs: RunLogs, scenario: Scenario) -> list[str]:
    log, prefix = logs.sides.get("patient"), f"{ESTIMATES}/"
    topics = () if log is None else sorted(log.rows)
    return _in_order([topic.removeprefix(prefix) for topic in topics if topic.startswith(prefix)], scenario)


def _in_order(names: list[str], scenario: Scenario) -> list[str]:
    asked = [name for name in scenario.estimators if name in names]
    return asked + [name for name in names if name not in asked]


def _at(rows: dict[int, Row], ticks: list[int]) -> Array:
    missing: Row = {"position_m": None}
    return _xyz([rows.get(tick, missing) for tick in ticks])


def _xyz(rows: list[Row]) -> Array:
    nowhere = {"x": np.nan, "y": np.nan, "z": np.nan}
    points = [row["position_m"] or nowhere for row in rows]
    return np.array([[point["x"], point["y"], point["z"]] for point in points], dtype=float).reshape(-1, 3)
