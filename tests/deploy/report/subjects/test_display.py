"""Errors of the surgeon's display, against the messages of the log read one by one."""

import json
from math import dist, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.log_reader import LogReader
from tis.common.scenario import reading
from tis.deploy.logs.read.load import load_run
from tis.deploy.report.subjects.display import display_summary, display_tables, displayed
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, run_twin

_SETTINGS = (
    "patient.plant={kind: servo, bandwidth_hz: 5}", "estimators=[hold]", "active_estimator=hold",
    "network.forward.delay.delay_ms=120", "network.feedback.delay.delay_ms=80",
)  # fmt: skip


def _twin(path: Path) -> None:
    scenario = resolve("default", _SETTINGS, seed=3, duration_s=8.0)
    nodes, models, _ = build_sides(scenario)
    path.mkdir(exist_ok=True)
    (path / "scenario.yaml").write_text(reading.dump_scenario(scenario))
    run_twin(scenario, nodes, models, path)


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run")
    _twin(path)
    return path


def _records(path: Path, topic: str) -> list[dict[str, Any]]:
    return [json.loads(data) for name, data in _raw(path) if name == topic]


def _raw(path: Path) -> list[tuple[str, bytes]]:
    return [(topic, message.data) for topic, message in LogReader(path).messages()]


def _point(value: dict[str, float]) -> tuple[float, ...]:
    return value["x"], value["y"], value["z"]


def test_errors_are_those_of_the_messages(run_dir: Path) -> None:
    found = display_summary(load_run(run_dir), {"left": None})["left"]
    assert found is not None
    displays = _records(run_dir / "surgeon.mcap", "tis/PSM2/predicted_cp")
    arm_m = {row["tick"]: _point(row["position_m"]) for row in _records(run_dir / "patient.mcap", "/tis/plant")}
    fresh = _records(run_dir / "patient.mcap", "/tis/fresh")
    begin_ns = displays[0]["sample_ns"] + 2_000_000_000
    shown_mm, predicted_mm = [], []
    for display in displays:
        ticks = [row["tick"] for row in fresh if row["sample_ns"] >= display["sample_ns"]]
        if display["sample_ns"] >= begin_ns and ticks:
            shown_mm.append(1e3 * dist(_point(display["shown_m"]), arm_m[min(ticks)]))
            predicted_mm.append(1e3 * dist(_point(display["position_m"]), arm_m[min(ticks)]))
    assert found["n"] == len(shown_mm) > 150
    for name, errors_mm in (("feedback_mm", shown_mm), ("predicted_mm", predicted_mm)):
        assert found[name]["at_effect"]["rms"] == pytest.approx(sqrt(sum(e * e for e in errors_mm) / len(errors_mm)))
        assert found[name]["at_effect"]["max"] == pytest.approx(max(errors_mm))
    assert found["ratio"] < 0.2, "the prediction is far better than what is shown late"
    trips_ms = [display["round_trip_ns"] / 1e6 for display in displays if display["sample_ns"] >= begin_ns]
    assert found["round_trip_ms"]["max"] == pytest.approx(max(trips_ms))
    assert 200 <= found["round_trip_ms"]["p50"] <= 240, "120 ms forward, 80 back, and up to a tick"


def test_the_arm_now_lies_between_the_ticks_beside(run_dir: Path) -> None:
    display = displayed(load_run(run_dir), "left")
    assert display is not None
    plant = _records(run_dir / "patient.mcap", "/tis/plant")
    t_ns, x_m = [row["t_ns"] for row in plant], [row["position_m"]["x"] for row in plant]
    known = np.isfinite(display.now_m[:, 0])
    assert known.sum() > 200
    assert display.now_m[known, 0] == pytest.approx(np.interp(display.sample_ns[known], t_ns, x_m))


def test_the_displays_of_two_twins_are_the_same_bytes(run_dir: Path, tmp_path: Path) -> None:
    _twin(tmp_path / "again")
    once, again = (
        [data for name, data in _raw(path / "surgeon.mcap") if name.endswith("/predicted_cp")]
        for path in (run_dir, tmp_path / "again")
    )
    assert len(once) > 200
    assert once == again


def test_a_log_without_displays_has_no_figures(run_dir: Path) -> None:
    logs = load_run(run_dir, wanted=("/tis/plant",))
    assert display_summary(logs, {"left": None}) == {"left": None}
    assert display_tables({"left": None}) == []


def test_tables_show_what_the_summary_holds(run_dir: Path) -> None:
    found = display_summary(load_run(run_dir), {"left": None})["left"]
    assert found is not None
    (table,) = display_tables({"left": found})
    feedback, predicted = table.texts()
    assert feedback[0] == "delayed feedback"
    assert float(predicted[1]) == pytest.approx(found["predicted_mm"]["at_effect"]["rms"], abs=6e-4)
    assert float(feedback[-1]) == pytest.approx(found["feedback_mm"]["now"]["rms"], rel=0.01)
    assert predicted[0] == "predicted arm"
