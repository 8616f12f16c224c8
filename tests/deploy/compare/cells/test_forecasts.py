"""Forecasts of one twin against twins in which everything is late by the horizon."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tis.common.channels import Side
from tis.common.runtime.recordings import load_recording
from tis.common.scenario import Scenario
from tis.deploy.compare.cells.cell import run_cell
from tis.deploy.compare.cells.forecasts import ORIGIN_EVERY, ForecastRecorder, forecast_sums, record_forecasts
from tis.deploy.compare.cells.measured import measure_estimators
from tis.deploy.compare.plan import Request, make_plan
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.side_log import MemoryLog
from tis.deploy.report.subjects.tracking import track_of_hand
from tis.deploy.run.twin import build_sides, drive
from tis.patient_side.estimators.adaptive_kf import AdaptiveKf
from tis.patient_side.estimators.innovations_kf import InnovationsKf
from tis.patient_side.node import PatientNode


def _scenario(small: Path, delay_ms: int) -> Scenario:
    settings = (
        f"network.forward.delay.delay_ms={delay_ms}",
        "patient.tick_phase_ms=0",
        "estimators=[hold, innovations_kf]",
        "active_estimator=hold",
        "identification.train=own_head",
    )
    return make_plan(Request(str(small), settings, trials=("T002",))).cells[0].scenario


def _driven(scenario: Scenario, n_ahead: int) -> tuple[RunLogs, list[dict[str, ForecastRecorder]]]:
    nodes, _, _ = build_sides(scenario)
    patient = nodes["patient"]
    assert isinstance(patient, PatientNode)
    for hand in patient.hands:  # the default learns from its own forecasts, and of late samples other things
        hand.estimators = [
            InnovationsKf(one.model) if isinstance(one, AdaptiveKf) else one for one in hand.estimators
        ]
        hand.states = [one.initial() for one in hand.estimators]
    measure_estimators(patient)
    recorders = record_forecasts(patient, n_ahead) if n_ahead else []
    memories: dict[Side, MemoryLog] = {side: MemoryLog(side) for side in nodes}
    drive(scenario, nodes, memories)
    return RunLogs(Path(), {side: memory.log for side, memory in memories.items()}), recorders


@pytest.mark.parametrize("n_ahead", [3, 12])
def test_a_forecast_is_the_estimate_where_all_is_late_by_the_horizon(small: Path, n_ahead: int) -> None:
    _, (recorders,) = _driven(_scenario(small, 0), n_ahead)
    scenario = _scenario(small, n_ahead * 1000 // 30)
    logs, _ = _driven(scenario, 0)
    track = track_of_hand(logs, scenario, "left")
    for name in ("hold", "innovations_kf"):
        forecasts = recorders[name].forecasts_m
        ticks = [i for i, tick in enumerate(track.tick) if track.scored[i] and (tick - n_ahead) % ORIGIN_EVERY == 0]
        assert len(ticks) > 30
        late = track.estimates[name][ticks]
        at_once = np.array([forecasts[int(track.tick[i]) - n_ahead][-1] for i in ticks])
        np.testing.assert_allclose(at_once, late, rtol=0, atol=1e-9)


def test_sums_begin_after_the_settling_time_and_end_with_the_recording(small: Path) -> None:
    scenario = _scenario(small, 0)
    _, recorders = _driven(scenario, 15)
    recording = load_recording(scenario)
    sums = forecast_sums(recording, recorders)["left"]
    truth_m = recording.hands[0].follower.position_m[recording.start :]
    origins = [i for i in range(60, len(truth_m) - 15, ORIGIN_EVERY) if i in recorders[0]["hold"].forecasts_m]
    assert sums["hold"]["n"] == sums["innovations_kf"]["n"] == len(origins)
    # hold's forecast is the sample itself
    moved = np.array([truth_m[i + 15] - truth_m[i] for i in origins])
    assert sums["hold"]["squares_m2"][-1] == pytest.approx((moved**2).sum(axis=0), rel=1e-6)


def test_a_missing_forecast_counts_with_that_of_hold(small: Path) -> None:
    scenario = _scenario(small, 0)
    _, recorders = _driven(scenario, 3)
    missing = recorders[0]["innovations_kf"]
    missing.forecasts_m = {origin: np.full((3, 3), np.nan) for origin in missing.forecasts_m}
    sums = forecast_sums(load_recording(scenario), recorders)["left"]
    assert sums["innovations_kf"] == sums["hold"]


def test_a_cell_has_forecasts_only_when_it_is_to(small: Path) -> None:
    cell = make_plan(Request(str(small), trials=("T002",), duration_s=3.0)).cells[0]
    cell = replace(cell, scenario=_scenario(small, 0))
    assert "forecasts" not in run_cell(cell, None)
    found = run_cell(replace(cell, n_ahead=2), None)["forecasts"]
    assert set(found) == {"left"}
    assert set(found["left"]) == {"hold", "innovations_kf"}
    assert len(found["left"]["hold"]["distance_m"]) == 2
