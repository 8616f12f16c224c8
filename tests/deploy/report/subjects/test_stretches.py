"""The arm in each network of a run in virtual time, whose delay is changed twice at instants that are known."""

import json
from copy import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec import to_builtins

from tis.common.device_records import TARGET_RUNS, TargetRunNote
from tis.common.messages import Vector3
from tis.common.records import CONTACTS, ContactNote, ControlNote
from tis.deploy.logs.read.load import RunLogs, load_run
from tis.deploy.report.measured_run import MeasuredRun
from tis.deploy.report.subjects.stretches import Stretch, stretch_tables, stretches, target_table
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, run_twin

_WAY = "{delay: {kind: constant, delay_ms: 40}}"
_NETWORK = f"network={{forward: {_WAY}, feedback: {_WAY}}}"
SCENARIO = resolve("default", ["estimators=[hold]", "active_estimator=hold", _NETWORK], None, 12.0)


def _note(at_s: float, operation: str, *changes: dict[str, object], for_s: float | None = None) -> ControlNote:
    lasting = {} if for_s is None else {"for_s": for_s}
    added = [{"at_s": at_s, "direction": "both", "set": one, **lasting} for one in changes]
    at_ns = round(at_s * 1e9)
    return ControlNote(
        at_ns=at_ns - 500_000, applied_ns=at_ns, operation=operation, request="{}", added=json.dumps(added),
        accepted=True,
    )  # fmt: skip


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> RunLogs:
    notes = [
        _note(5.0, "reset"),
        _note(5.03, "set", {"delay": {"kind": "constant", "delay_ms": 240}}),
        _note(8.0, "outage", {"outage": True}, for_s=1.0),
        _note(10.0, "set", {"rate": {"kbit_s": 900, "cross": {"kind": "poisson", "kbit_s": 600}}}),
    ]
    run_dir = tmp_path_factory.mktemp("run")
    nodes, models, _ = build_sides(SCENARIO, notes)
    run_twin(SCENARIO, nodes, models, run_dir)
    return load_run(run_dir)


def _found(logs: RunLogs) -> list[Stretch]:
    run = MeasuredRun(logs, SCENARIO, {"left": "PSM2"})
    each: list[Stretch] = stretches(logs, SCENARIO, run.requests, run.tracks, run.arms)["stretches"]["left"]
    return each


def test_each_network_has_its_delay_its_time_of_movement_and_the_arms_lateness(logs: RunLogs) -> None:
    short, late, outage, last, _ = _found(logs)
    spans = [edge_s for one in (short, late, outage) for edge_s in (one.begin_s, one.end_s)]
    assert spans == pytest.approx([0.0, 5.0, 5.03, 8.0, 8.0, 9.0], abs=1e-3)
    assert [one.delay_ms["forward"] for one in (short, late, last)] == pytest.approx([40.0, 240.0, 240.0])
    assert [one.loss_pct["feedback"] for one in (short, late, outage, last)] == [0.0, 0.0, 100.0, 0.0]
    assert short.late_ms == pytest.approx(40.0, abs=35.0)  # a sample is up to a period older than its message
    assert late.late_ms == pytest.approx(240.0, abs=35.0)
    assert short.rmse_3d_mm is not None
    assert late.rmse_3d_mm is not None
    assert late.rmse_3d_mm > 2 * short.rmse_3d_mm
    assert 2.5 < late.moved_s < 2.98
    (table,) = stretch_tables({"left": _found(logs)})
    assert [row[1] for row in table.rows] == [
        "40 ms each way", "240 ms each way", "outage each way", "240 ms each way",
        "240 ms and a queue at 900 kbit/s, shared with 600 kbit/s of others, poisson each way",
    ]  # fmt: skip


def test_at_rest_there_is_no_lateness_and_no_error(logs: RunLogs) -> None:
    run = MeasuredRun(logs, SCENARIO, {"left": "PSM2"})
    track = run.tracks["left"]
    track.truth_m[:], track.estimates["hold"][:] = 0.1, 0.1
    each = stretches(logs, SCENARIO, run.requests, {"left": track}, run.arms)["stretches"]["left"]
    assert {(one.moved_s, one.late_ms, one.rmse_3d_mm) for one in each} == {(0.0, None, None)}


def test_a_short_movement_has_an_error_and_no_lateness(logs: RunLogs) -> None:
    """Hand and arm must each move for 2 s: the one second of the outage never suffices."""
    run = MeasuredRun(logs, SCENARIO, {"left": "PSM2"})
    assert [one.late_ms is None for one in _found(logs)] == [False, False, True, True, False]
    for still in ("hand", "arm"):
        track = run.tracks["left"]
        hand_m, arm_m = track.truth_m.copy(), track.estimates["hold"].copy()
        rests = (track.t_ns > 5.5e9) & (track.t_ns < 8e9)
        (hand_m if still == "hand" else arm_m)[rests] = 0.1
        track = replace(track, truth_m=hand_m, estimates={"hold": arm_m})
        each = stretches(logs, SCENARIO, run.requests, {"left": track}, run.arms)["stretches"]["left"]
        assert [one.late_ms is None for one in each] == [False, True, True, True, False]
        assert each[1].rmse_3d_mm is not None
        (table,) = stretch_tables({"left": each})
        assert table.rows[1][4] is None


def test_moves_far_apart_do_not_add_up_to_a_movement(logs: RunLogs) -> None:
    """A hand that twitches every second has moved for no more than its twitches, whatever lies between them."""
    run = MeasuredRun(logs, SCENARIO, {"left": "PSM2"})
    track = run.tracks["left"]
    held = np.flatnonzero((track.t_ns > 5.5e9) & (track.t_ns < 8e9))
    hand_m, arm_m = track.truth_m.copy(), track.estimates["hold"].copy()
    for position_m in (hand_m, arm_m):
        position_m[held] = position_m[held[0]] + 0.001 * ((held - held[0]) // 10)[:, None]
    track = replace(track, truth_m=hand_m, estimates={"hold": arm_m})
    each = stretches(logs, SCENARIO, run.requests, {"left": track}, run.arms)["stretches"]["left"]
    assert each[1].moved_s < 1.5
    assert each[1].late_ms is None


def test_where_the_arm_touched_something_there_is_no_lateness(logs: RunLogs) -> None:
    known = RunLogs(logs.run_dir, dict(logs.sides))
    known.sides["patient"] = copy(logs.sides["patient"])
    known.sides["patient"].rows = dict(known.sides["patient"].rows)
    rows = [
        ContactNote(
            hand="left",
            tick=tick,
            t_ns=tick * 33_333_333,
            force_n=Vector3(x=0.0, y=0.0, z=force_n),
            sent=True,
            active=True,
        )
        for tick, force_n in ((120, 0.0), (200, 1.5))
    ]
    known.sides["patient"].add_rows(CONTACTS, [to_builtins(one) for one in rows])
    assert [one.late_ms is None for one in _found(known)] == [False, True, True, True, False]


def test_a_run_whose_network_nobody_changed_has_none(tmp_path: Path) -> None:
    nodes, models, _ = build_sides(SCENARIO)
    run_twin(SCENARIO, nodes, models, tmp_path)
    run = MeasuredRun(load_run(tmp_path), SCENARIO, {"left": "PSM2"})
    assert stretches(run.logs, SCENARIO, run.requests, run.tracks, run.arms) == {}
    assert stretches(RunLogs(tmp_path), SCENARIO, {}, {}, {}) == {}
    assert target_table(run.logs).rows == []


def test_runs_at_targets_are_shown_as_the_page_told_them(logs: RunLogs) -> None:
    note = TargetRunNote(
        at_ns=61_000_000_000, hand="left", delay_ms=300, with_ghost=True, time_s=12.34, path_mm=402.6, n_misses=1
    )
    logs.sides["surgeon"].add_rows(TARGET_RUNS, [{name: getattr(note, name) for name in note.__struct_fields__}])
    assert target_table(logs).rows == [("61.0 s", "300 ms", "picture and ghost", "12.3", "403", 1)]
