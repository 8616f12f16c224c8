"""Redundancy on the wire in a whole twin: what it gains, what it costs, and that every promise still holds."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.deploy.hold_only import HOLD
from tis.common.channels import Side
from tis.common.records import ESTIMATES, FRESH
from tis.common.scenario import Scenario
from tis.deploy.logs.read.load import RunLogs, load_run
from tis.deploy.logs.read.side_log import MemoryLog
from tis.deploy.report.subjects.age import ages_ns
from tis.deploy.report.subjects.latency import sample_latency, used_samples
from tis.deploy.report.summarise import build_summary
from tis.deploy.run.replay import replay
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, drive, run_twin
from tis.patient_side.identification.model_file import dump_models
from tis.patient_side.statespace import ArmModel

LOW_MS, HIGH_MS = 100.0, 700.0
SPREAD = (
    f"network={{forward: {{delay: {{kind: uniform, low_ms: {LOW_MS}, high_ms: {HIGH_MS}}}, ordering: reorder}}}}",
    *HOLD,
)


@cache
def _twin(*settings: str, duration_s: float = 20.0) -> tuple[RunLogs, Scenario, tuple[ArmModel, ...]]:
    scenario = resolve("default", [*SPREAD, *settings], None, duration_s)
    nodes, models, _ = build_sides(scenario)
    memories: dict[Side, MemoryLog] = {side: MemoryLog(side) for side in nodes}
    drive(scenario, nodes, memories)
    return RunLogs(Path(), {side: memory.log for side, memory in memories.items()}), scenario, models


@cache
def _summary(*settings: str) -> dict[str, Any]:
    logs, scenario, models = _twin(*settings)
    return build_summary(logs, scenario, models, "twin", 0, "")


def _expected_age_ms(copies: int, phase_ms: float = 2.0, period_ms: float = 1000 / 30) -> float:
    """Return the mean age of the freshest of 2 copies x streams packets a sample, by the product of probabilities."""
    ages = phase_ms + period_ms * np.arange(40)
    missing = (1.0 - np.clip((ages - LOW_MS) / (HIGH_MS - LOW_MS), 0.0, 1.0)) ** (2 * copies)
    fresher_missing = np.concatenate([[1.0], np.cumprod(missing)[:-1]])
    return float(np.sum(ages * fresher_missing * (1.0 - missing)))


@pytest.mark.parametrize("copies", [1, 4])
def test_the_age_is_what_probability_says_of_independent_delays(copies: int) -> None:
    logs, *_ = _twin(f"surgeon.copies={copies}")
    settled = ages_ns(logs)[60:] / 1e6
    assert settled.mean() == pytest.approx(_expected_age_ms(copies), rel=0.05)


def test_four_copies_are_fresher_than_one_and_cost_four_times_as_much() -> None:
    one, four = _summary(), _summary("surgeon.copies=4")
    assert four["age_ms"]["p95"] < 0.8 * one["age_ms"]["p95"]
    for key, traffic in one["surgeon_traffic"].items():
        assert traffic["packets"] == 600
        assert four["surgeon_traffic"][key] == {name: 4 * value for name, value in traffic.items()}


def test_first_packets_alone_are_what_a_run_that_sends_once_is() -> None:
    """Where each packet has its own fate, sending once has the law of first packets among several."""
    lossy = "network.forward.loss={kind: bernoulli, p_loss: 0.2}"
    plain, rich = _summary(lossy)["redundancy"], _summary(lossy, "surgeon={copies: 4, history: 3}")["redundancy"]
    for name in ("packets_per_s", "bytes_per_s"):
        assert plain["price"][name] == pytest.approx(plain["price"][f"{name}_once"])
        assert rich["price"][f"{name}_once"] == pytest.approx(plain["price"][name], rel=1e-3)
    assert plain["lost"]["packets_pct"] == plain["lost"]["samples_pct"] == plain["lost"]["samples_once_pct"]
    assert plain["age_ms"] == plain["age_once_ms"]
    assert rich["lost"]["packets_pct"] == pytest.approx(plain["lost"]["packets_pct"], abs=5)
    assert rich["lost"]["samples_once_pct"] == pytest.approx(plain["lost"]["samples_pct"], abs=5)
    assert rich["lost"]["samples_pct"] < 0.5  # the last ones have nobody to ride with: 0.2^4 of them are lost
    assert rich["age_once_ms"]["mean"] == pytest.approx(plain["age_ms"]["mean"], rel=0.05)
    assert rich["age_ms"]["mean"] < 0.8 * plain["age_ms"]["mean"]


def test_ages_recomputed_from_arrivals_are_those_that_the_patient_noted() -> None:
    settings = ("network.forward.loss={kind: bernoulli, p_loss: 0.2}", "surgeon={copies: 2, copy_spacing_ms: 8}")
    found = _summary(*settings)
    noted_ms = ages_ns(_twin(*settings)[0]) / 1e6
    age_ms = found["redundancy"]["age_ms"]
    assert age_ms["p95"] == pytest.approx(found["age_ms"]["p95"])
    # but for the first ticks, at which no first packet had arrived
    assert age_ms["mean"] == pytest.approx(noted_ms.mean(), rel=0.01)
    assert age_ms["max"] == pytest.approx(noted_ms.max())


@pytest.mark.parametrize("settings", [("surgeon.copies=3", "surgeon.copy_spacing_ms=45"), ("surgeon.history=6",)])
def test_the_books_balance_packet_by_packet_and_the_parts_add_up(settings: tuple[str, ...]) -> None:
    lossy = "network.forward.loss={kind: bernoulli, p_loss: 0.2}"
    summary = _summary(lossy, *settings)
    assert summary["problems"] == []
    link = summary["links"]["forward"]
    copies = 3 if "surgeon.copies=3" in settings else 1
    assert link["sent"] == 2 * 600 * copies
    assert (link["unplanned_loss"], link["duplicated"]) == (0, 0)
    assert summary["recovered"] > 0 or copies > 1
    logs, scenario, models = _twin(lossy, *settings)
    parts = sample_latency(used_samples(logs, scenario.session, {model.hand: model.arm for model in models}))
    assert np.array_equal(parts.end_to_end, parts.surgeon + parts.network + parts.tick_wait + parts.compute)
    assert set((parts.surgeon // 45_000_000).tolist()) == set(range(copies))
    assert np.all(parts.network >= LOW_MS * 1e6)
    trip = summary["latency_ms"]["round_trip"]
    assert trip["p50"] == pytest.approx(summary["latency_ms"]["end_to_end"]["p50"], abs=0.01)


def test_history_brings_back_lost_samples_and_fills_the_buffer() -> None:
    """Half of the packets are lost, 8 ride along: of the samples before, all but 1 of 2^9 come."""
    half = "network.forward={loss: {kind: bernoulli, p_loss: 0.5}, delay: {kind: constant, delay_ms: 10}}"
    plain, riding = _summary(half), _summary(half, "surgeon.history=8")
    lost = plain["links"]["forward"]["dropped"]
    assert riding["links"]["forward"]["dropped"] == lost  # the same fates
    assert riding["recovered"] == pytest.approx(lost, rel=0.02)
    assert riding["repeated"] == plain["repeated"] == 0
    per_packet = [entry["bytes"] / entry["packets"] for entry in riding["surgeon_traffic"].values()]
    assert min(per_packet) > 5 * 250


def test_twins_with_redundancy_are_equal_and_replay_bit_for_bit(tmp_path: Path) -> None:
    """That models are equal when they are identified again is test_twin's claim."""
    settings = ["surgeon={copies: 3, copy_spacing_ms: 20, history: 2}", "source.hands=[left, right]"]
    rows = []
    for name in ("a", "b"):
        scenario = resolve("lossy", settings, None, 3.0)
        nodes, models, _ = build_sides(scenario)
        (tmp_path / name).mkdir()
        run_twin(scenario, nodes, models, tmp_path / name)
        (tmp_path / name / "scenario.yaml").write_text(_dumped(scenario))
        (tmp_path / name / "model.json").write_bytes(dump_models(models))
        logs = load_run(tmp_path / name)
        rows.append([logs.of("patient", topic) for topic in (f"{ESTIMATES}/{scenario.active_estimator}", FRESH)])
    assert rows[0] == rows[1]
    assert replay(tmp_path / "a").identical


def _dumped(scenario: Scenario) -> str:
    from tis.common.scenario.reading import dump_scenario

    return dump_scenario(scenario)
