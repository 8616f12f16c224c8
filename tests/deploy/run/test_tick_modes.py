"""``patient.tick`` in the twin: what each mode promises, saves, and leaves as it was."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tis.common.records import PHASES, PROMPT, TICKS
from tis.common.scenario import Scenario
from tis.deploy.logs.read.load import RunLogs, load_run
from tis.deploy.report.summarise import build_summary
from tis.deploy.run.replay import replay
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, run_twin
from tis.deploy.shell import run_dir as folder
from tis.patient_side.identification.model_file import dump_models
from tis.patient_side.statespace import ArmModel

STEADY = (
    "network.forward.jitter=null",
    "network.forward.loss=null",
    "estimators=[hold, moesp_kf]",
    "active_estimator=moesp_kf",
    "patient.orientation={methods: [hold], active: hold}",
)
PERIOD_MS = 1000 / 30


def scenario(mode: str, *settings: str, duration_s: float = 6.0) -> Scenario:
    return resolve("default", (f"patient.tick={mode}", *settings), None, duration_s)


def run_of(what: Scenario, run_dir: Path) -> tuple[ArmModel, ...]:
    folder.create(run_dir, what)
    nodes, models, _ = build_sides(what)
    run_twin(what, nodes, models, run_dir)
    folder.write(run_dir / "model.json", dump_models(models))
    return models


def twin(what: Scenario, run_dir: Path) -> tuple[RunLogs, dict[str, Any]]:
    models = run_of(what, run_dir)
    logs = load_run(run_dir)
    return logs, build_summary(logs, what, models, "twin", 0, "")


@pytest.mark.parametrize("mode", ["phase_locked", "on_arrival"])
def test_every_mode_keeps_its_promises(mode: str, tmp_path: Path) -> None:
    """L0: two twins are bit-equal. L2: the recorded arrivals give the same estimates, those at arrivals too."""
    lossy = ("network.forward.jitter.std_ms=8", "network.forward.loss.p_loss=0.1")
    what = scenario(mode, *lossy, duration_s=5.0)
    for name in ("one", "two"):
        run_of(what, tmp_path / name)
    for side in ("surgeon", "netem", "patient"):
        log = f"{side}.mcap"
        assert (tmp_path / "one" / log).read_bytes() == (tmp_path / "two" / log).read_bytes()
    found = replay(tmp_path / "one")
    assert found.identical
    logs = load_run(tmp_path / "one")
    n_prompt = len(logs.of("patient", PROMPT))
    assert found.n_compared == (4 + 2) * 150 + n_prompt + len(logs.of("patient", "tis/PSM2/servo_cp"))
    assert (n_prompt > 100) == (mode == "on_arrival")


def test_answers_at_arrivals_change_nothing_at_the_ticks(tmp_path: Path) -> None:
    free, free_summary = twin(scenario("free"), tmp_path / "free")
    prompt, prompt_summary = twin(scenario("on_arrival"), tmp_path / "prompt")
    for name in ("hold", "damped_velocity", "moesp_kf"):
        topic = f"/tis/estimates/{name}"
        assert list(free.of("patient", topic)) == list(prompt.of("patient", topic)), name
    assert free_summary["accuracy"] == prompt_summary["accuracy"]
    assert free_summary["age_ms"] == prompt_summary["age_ms"]
    assert free_summary["tick_modes"]["on_arrival"] == prompt_summary["tick_modes"]["on_arrival"]


def test_a_sample_that_is_answered_on_arrival_waits_for_nothing(tmp_path: Path) -> None:
    logs, summary = twin(scenario("on_arrival", *STEADY), tmp_path / "run")
    assert summary["problems"] == []
    latency = summary["latency_ms"]
    assert latency["tick_wait"]["max"] == 0
    assert latency["end_to_end"]["p50"] == latency["end_to_end"]["max"] == pytest.approx(40, abs=1e-5)
    assert latency["round_trip"]["p50"] == pytest.approx(80, abs=20)
    assert summary["superseded"] == 1  # the last but one sample, which comes after the last tick
    sent = logs.messages("patient", "feedback", "tis")["tis/PSM2/estimated_cp"]
    assert sent.seq.tolist() == list(range(len(sent)))  # numbered in their order: nothing looks reordered
    assert len(sent) == len(logs.of("patient", PROMPT)) + len(
        [row for row in logs.of("patient", TICKS) if row["due_ns"] >= 40_000_000]
    )
    assert np.diff(sent.sample_ns).min() > 0


def test_ticks_move_once_to_just_behind_a_constant_delay(tmp_path: Path) -> None:
    _, free_summary = twin(scenario("free", *STEADY), tmp_path / "free")
    logs, summary = twin(scenario("phase_locked", *STEADY), tmp_path / "locked")
    (shift,) = logs.of("patient", PHASES)
    behind_ms = 40 - PERIOD_MS + PERIOD_MS / 100  # 1 % of a period behind the arrivals
    assert shift["phase_ns"] / 1e6 == pytest.approx(behind_ms, abs=1e-4)
    assert shift["tick"] == 29
    assert (shift["age_before_ns"] - shift["age_ns"]) / 1e6 == pytest.approx(68.667 - 40.333, abs=0.01)
    due_ns = np.array([row["due_ns"] for row in logs.of("patient", TICKS)])
    assert np.diff(due_ns).min() > 0
    assert summary["latency_ms"]["end_to_end"]["p50"] == pytest.approx(40 + PERIOD_MS / 100, abs=1e-4)
    assert free_summary["latency_ms"]["end_to_end"]["p50"] == pytest.approx(2 + 2 * PERIOD_MS, abs=1e-4)
    modes = free_summary["tick_modes"]
    assert modes["phase_locked"]["saves_ms"] == pytest.approx(68.667 - 40.333, abs=0.01)
    assert modes["on_arrival"]["saves_ms"] == pytest.approx(68.667 - 40, abs=0.01)
    assert "save 28.3 ms" in modes["line"]
    assert summary["accuracy"]["hold"]["rmse_3d_mm"] < 0.7 * free_summary["accuracy"]["hold"]["rmse_3d_mm"]
    assert len({entry["n_scored"] for entry in summary["accuracy"].values()}) == 1
