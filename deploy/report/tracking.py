"""The summary's ``accuracy``: every estimator against the recorded arm, on the same ticks."""

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


def accuracy_of_hand(logs: RunLogs, scenario: Scenario, hand: Hand, model: ArmModel) -> dict[str, Any]:
    """Return the scores of all estimators for one hand, and of the plant when it is a servo."""
    truth_rows = sorted(
        (row for row in logs.of("surgeon", TRUTH) if row["hand"] == hand), key=lambda row: row["sample_ns"]
    )
    prefix = f"{ESTIMATES}/"
    log = logs.sides.get("patient")
    names = (
        [] if log is None else sorted(topic.removeprefix(prefix) for topic in log.rows if topic.startswith(prefix))
    )
    by_name = {name: [row for row in logs.of("patient", prefix + name) if row["hand"] == hand] for name in names}
    if "hold" not in by_name or not truth_rows:
        return {}
    t_ns = np.array([row["t_ns"] for row in by_name["hold"]], dtype=np.int64)
    ticks = [row["tick"] for row in by_name["hold"]]
    truth_m = truth_at(t_ns, np.array([row["sample_ns"] for row in truth_rows], dtype=np.int64), _xyz(truth_rows))
    hold_m = _xyz(by_name["hold"])
    arrivals = logs.messages("patient", "forward", scenario.session)
    first_ns = min((row["_log_ns"] for _, row in arrivals), default=None)
    scored = scored_ticks(t_ns, truth_m, hold_m, first_ns)
    range_m = model.output_high_m - model.output_low_m
    result: dict[str, Any] = {}
    for name in _in_order(names, scenario):
        rows = {row["tick"]: row for row in by_name[name]}
        entry: dict[str, Any] = dict(score(_at(rows, ticks), hold_m, truth_m, scored, range_m))
        steps_ns = np.array([row["step_ns"] for row in by_name[name]], dtype=np.int64)
        measured = steps_ns if steps_ns.any() else steps_ns[:0]
        entry["step_us"] = summarise(measured / NS_PER_US, percentiles=(50, 99), also=())
        result[name] = entry
    if scenario.patient.plant.kind == "servo":
        rows = {row["tick"]: row for row in logs.of("patient", PLANT) if row["hand"] == hand}
        result["plant"] = dict(score(_at(rows, ticks), hold_m, truth_m, scored, range_m))
    return result


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
