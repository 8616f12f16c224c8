"""A run is asked for the rows of a trace that it played: the trace climbs, so its beginning is not its mean."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.deploy.report.hand_made import COMMAND, MS, a_scenario
from tis.common.scenario import Scenario
from tis.common.scenario.network.pipeline import Pipeline
from tis.common.trace import LOST, Trace
from tis.deploy.logs.read.load import RunLogs, load_run
from tis.deploy.logs.read.packets import link_fates
from tis.deploy.report.subjects.network.requested import Requested
from tis.deploy.report.subjects.network.requested_pipeline import (
    delay_moments_ns,
    p_loss,
    requested_pipeline,
    with_played_rows,
)
from tis.deploy.report.summarise import build_summary
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, run_twin
from tis.netem.expected.simulate import simulate

N_ROWS = 500
ROWS_MS = [(120.0 * i, None if i % 7 == 3 else 10.0 + i) for i in range(N_ROWS)]


@pytest.fixture
def path(tmp_path: Path) -> str:
    file = tmp_path / "climbs.csv"
    rows = [f"{sent_ms / 1000},{'' if delay_ms is None else delay_ms}" for sent_ms, delay_ms in ROWS_MS]
    file.write_text("\n".join(["sent_s,delay_ms", *rows]))
    return str(file)


def _trace() -> Trace:
    delays = [LOST if delay_ms is None else round(delay_ms * MS) for _, delay_ms in ROWS_MS]
    return Trace("climbs", np.array([round(ms * MS) for ms, _ in ROWS_MS]), np.array(delays))


def _part(advance: str, path: str = "t") -> dict[str, str]:
    return {"kind": "trace", "path": path, "advance": advance}


@pytest.mark.parametrize("advance", ["packet", "time"])
@pytest.mark.parametrize(
    "more",
    [
        {},
        {"jitter": {"kind": "normal", "std_ms": 8}},
        {"reorder": {"p_reorder": 0.2, "early_ms": 50}, "ordering": "reorder"},
        {"reorder": {"p_reorder": 0.2}, "ordering": "reorder"},
    ],
)
def test_moments_and_losses_of_each_packet_are_those_that_are_drawn(advance: str, more: dict[str, Any]) -> None:
    """Over 200 seeds: the mean of each packet's delay; without chance it is the delay itself."""
    network = a_scenario(network={"forward": {"delay": _part(advance), "loss": _part(advance), **more}}).network
    offered_ns, traces = np.arange(120) * 33 * MS, {"t": _trace()}
    asked = requested_pipeline(network.forward, traces)
    assert asked is not None
    seq = np.arange(120)
    mean_ns, std_ns = delay_moments_ns(asked, seq, offered_ns)
    drawn = [simulate(network, "forward", seed, offered_ns, traces=traces) for seed in range(200)]
    lost = drawn[0].lost
    assert p_loss(asked, seq, offered_ns, np.ones(120, dtype=np.int64)).tolist() == lost.astype(float).tolist()
    assert 0 < lost.sum() < 60
    delays = np.stack([one.delay_ns for one in drawn])[:, ~lost]
    off = np.abs(delays.mean(axis=0) - mean_ns[~lost])
    assert np.all(off <= 5 * std_ns[~lost] / np.sqrt(200) + 0.01 * MS * bool(more))
    assert np.allclose(delays.std(axis=0), std_ns[~lost], rtol=0.35)


@pytest.mark.parametrize(("of_delay", "of_loss"), [("packet", "packet"), ("time", "time"), ("packet", "time")])
def test_a_pipeline_of_the_rows_played_asks_for_what_they_hold(of_delay: str, of_loss: str) -> None:
    """Oracle: the draws of the whole run. Loss and delay by different rows: those lost lend their delay."""
    network = a_scenario(network={"forward": {"delay": _part(of_delay), "loss": _part(of_loss)}}).network
    offered_ns, traces = np.arange(300) * 10 * MS, {"t": _trace()}
    whole = requested_pipeline(network.forward, traces)
    assert whole is not None
    asked = with_played_rows(whole, np.arange(300), offered_ns)
    drawn = simulate(network, "forward", 1, offered_ns, traces=traces)
    all_of = simulate(
        network.model_copy(update={"forward": network.forward.model_copy(update={"loss": None})}),
        "forward", 1, offered_ns, traces=traces,
    )  # fmt: skip
    delays = drawn.delay_ns[~drawn.lost] if of_delay == of_loss else all_of.delay_ns
    assert asked.mean_ns == pytest.approx(delays.mean())
    assert asked.std_ns == pytest.approx(delays.std())
    assert asked.loss().p_loss == pytest.approx(drawn.lost.mean())
    assert abs(asked.mean_ns - whole.mean_ns) > 50 * MS


def test_without_a_trace_or_without_packets_it_is_what_is_asked_anyhow() -> None:
    plain = requested_pipeline(Pipeline.model_validate({"delay": {"kind": "uniform", "low_ms": 1, "high_ms": 3}}), {})
    traced = requested_pipeline(Pipeline.model_validate({"delay": _part("packet")}), {"t": _trace()})
    nothing = np.empty(0, dtype=np.int64)
    assert plain is not None
    assert traced is not None
    assert with_played_rows(plain, np.arange(3), np.arange(3)) is plain
    assert with_played_rows(traced, nothing, nothing) is traced


def _twin(scenario: Scenario, run_dir: Path) -> tuple[dict[str, Any], RunLogs]:
    nodes, models, _ = build_sides(scenario)
    run_dir.mkdir()
    run_twin(scenario, nodes, models, run_dir)
    logs = load_run(run_dir)
    links: dict[str, Any] = build_summary(logs, scenario, models, "twin", 0, "")["links"]
    return links, logs


@pytest.mark.parametrize("advance", ["packet", "time"])
def test_a_run_shorter_than_its_trace_is_faithful_to_the_rows_it_played(
    advance: str, path: str, tmp_path: Path
) -> None:
    part = f"{{kind: trace, path: {path}, advance: {advance}}}"
    scenario = resolve("default", [f"network.forward={{delay: {part}, loss: {part}}}"], None, 4.0)
    links, logs = _twin(scenario, tmp_path / "run")
    verdict, delay = links["forward"]["verdict"], links["forward"]["delay_ms"]
    assert verdict["faithful"]
    assert verdict["violations"] == []
    assert not any("delay" in text or "loss" in text for text in verdict["not_decidable"])
    for name in ("mean", "std", "p50"):
        assert delay["requested"][name] == pytest.approx(delay["decided"][name], rel=1e-6)
    assert links["forward"]["requested"]["loss_pct"] == pytest.approx(links["forward"]["loss_pct"])
    request = Requested.of(scenario, "forward", logs)
    together = request.shared_by(link_fates(logs, "forward"))
    assert together is not None
    assert together.mean_ns == pytest.approx(delay["decided"]["mean"] * MS, rel=1e-6)


def test_another_network_than_the_trace_is_still_seen(path: str, tmp_path: Path) -> None:
    """The very rows, each 1 ms later; and a run that lost nothing although the trace does."""
    part = f"{{kind: trace, path: {path}}}"
    asked = resolve("default", [f"network.forward={{delay: {part}, loss: {part}}}"], None, 4.0)
    other = resolve(
        "default",
        [f"network.forward={{delay: {part}}}", "network.timeline=[{at_s: 0, set: {add_delay_ms: 1}}]"],
        None,
        4.0,
    )
    _, logs = _twin(other, tmp_path / "run")
    links = build_summary(logs, asked, (), "twin", 0, "")["links"]
    said = links["forward"]["keys"][COMMAND]["verdict"]["violations"]
    assert [text.partition(":")[0] for text in said] == ["decided loss", "decided delay"]
