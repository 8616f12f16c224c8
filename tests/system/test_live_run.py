"""The main job with real processes: counts and bounds, never exact times."""

import json
import shutil
import socket
from pathlib import Path

import pytest
from mcap.reader import make_reader
from rich.console import Console

from tests.system.conftest import HOLD, Start, StartHere, is_right_but_for_the_machine, samples_taken
from tis.common.host_records import PROCESSORS
from tis.common.records import TICKS
from tis.deploy.logs.read.load import load_run
from tis.deploy.logs.read.packets import link_fates
from tis.deploy.run.conclude import conclude_again
from tis.deploy.run.consistency import compare_fates
from tis.deploy.run.replay import replay
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, run_twin

pytestmark = pytest.mark.live
SETTINGS = [
    "network.forward.loss.p_loss=0.1",
    "network.feedback.loss.p_loss=0.05",
    "network.forward.ordering=reorder",
]


def test_a_live_run_adds_up_replays_bit_for_bit_and_has_the_twins_fates(run_here: StartHere, tmp_path: Path) -> None:
    words = [word for setting in SETTINGS for word in ("--set", setting)]
    tis = run_here("run", "default", "--duration-s", "5", *words, identified=True)
    code, out, err = tis.wait()
    summary = tis.summary()
    assert is_right_but_for_the_machine(code, summary), (err, summary["problems"])
    assert "innovations_kf" in out

    for link in summary["links"].values():
        assert link["offered"] == link["released"] + link["dropped"] + link["held_at_end"]
        assert link["dropped"] > 0
        assert link["delay_ms"]["realised"]["mean"] >= link["delay_ms"]["decided"]["mean"]
    logs = load_run(tis.run_dir)
    assert len(logs.of("surgeon", TICKS)) == summary["ticks"]["count"] == 150
    assert summary["links"]["forward"]["sent"] == 2 * samples_taken(logs)
    latency = summary["latency_ms"]
    assert latency["end_to_end"]["p50"] > 40
    assert latency["round_trip"]["p50"] > latency["end_to_end"]["p50"] - 34

    for shares in summary["processors"].values():
        assert shares["wall_s"] > 5
        assert 0 < shares["own_pct"] < 100 * shares["n_processors"] + 1

    assert replay(tis.run_dir).identical
    _assert_a_changed_model_no_longer_replays_identically(tis.run_dir, tmp_path / "other")

    scenario = resolve("default", SETTINGS, None, 5.0)
    nodes, models, _ = build_sides(scenario)
    twin_dir = tmp_path / "twin"
    twin_dir.mkdir()
    run_twin(scenario, nodes, models, twin_dir)
    assert not load_run(twin_dir).of("netem", PROCESSORS)  # virtual time uses up no processor's
    found = compare_fates(logs, load_run(twin_dir), scenario)
    assert found.n_compared > 500 * samples_taken(logs) / 150
    assert found.n_different == 0

    for side in ("surgeon", "netem", "patient"):
        with (tis.run_dir / f"{side}.mcap").open("rb") as file:
            assert make_reader(file).get_summary() is not None
    manifest = json.loads((tis.run_dir / "manifest.json").read_text())
    assert set(manifest["exit_codes"].values()) == {0}
    assert "summary.json" in manifest["sha256"]


def _assert_a_changed_model_no_longer_replays_identically(run_dir: Path, other: Path) -> None:
    shutil.copytree(run_dir, other)
    changed = json.loads((other / "model.json").read_text())
    _halve_damping(changed)
    (other / "model.json").write_text(json.dumps(changed))
    assert replay(other).n_different > 0


def _halve_damping(node: object) -> None:
    if isinstance(node, dict):
        for key, value in node.items():
            if key == "damping":
                node[key] = value / 2
            _halve_damping(value)
    elif isinstance(node, list):
        for item in node:
            _halve_damping(item)


@pytest.mark.slow
def test_sides_alone_meet_in_any_order_and_run(
    start: Start, tmp_path: Path, endpoints: tuple[str, str], model_file: Path
) -> None:
    west, east = endpoints
    scenario = tmp_path / "s.yaml"
    scenario.write_text(
        "version: 1\nname: alone\nduration_s: 3\nsource: {kind: synthetic}\n"
        f"hosts: {{west: {west}, east: {east}}}\nnetwork: {{forward: {{delay: {{kind: constant, delay_ms: 10}}}}}}\n"
        f"identification: {{train: {model_file}}}\nestimators: [hold]\nactive_estimator: hold\n"
    )
    patient = start("patient", str(scenario), run_dir="p")
    patient.await_log("patient", n_bytes=0)  # it is ready and waits before anybody else is there
    surgeon = start("surgeon", str(scenario), "-e", west, run_dir="p")
    netem = start("netem", str(scenario), run_dir="p")
    ends = {side: tis.wait() for side, tis in (("patient", patient), ("surgeon", surgeon), ("netem", netem))}
    assert {side: code for side, (code, _, _) in ends.items()} == {"patient": 0, "surgeon": 0, "netem": 0}, ends
    assert f"patient: waiting for netem at {east}" in ends["patient"][2]
    logs = load_run(tmp_path / "p")
    assert logs.problems() == []
    assert len(link_fates(logs, "forward").seq) >= 2 * samples_taken(logs) > 90
    code = conclude_again(tmp_path / "p", Console(quiet=True))
    summary = json.loads((tmp_path / "p" / "summary.json").read_text())
    assert is_right_but_for_the_machine(code, summary), summary["problems"]
    assert (summary["mode"], summary["exit"]) == ("live", None)


def test_a_side_with_another_scenario_is_refused_by_all(
    start: Start, tmp_path: Path, endpoints: tuple[str, str]
) -> None:
    west, east = endpoints
    text = f"version: 1\nname: a\nduration_s: 3\nsource: {{kind: synthetic}}\nhosts: {{west: {west}, east: {east}}}\n"
    for name, seed in (("one", 1), ("two", 2)):
        (tmp_path / f"{name}.yaml").write_text(f"{text}seed: {seed}\n")
    netem = start("netem", str(tmp_path / "one.yaml"), run_dir="n")
    surgeon = start("surgeon", str(tmp_path / "two.yaml"), run_dir="s")
    for tis, other, here, there in ((netem, "surgeon", 1, 2), (surgeon, "netem", 2, 1)):
        code, _, err = tis.wait()
        assert code == 3
        assert f"{other}: scenario: must be the one that" in err
        assert f"seed is {there} there, {here} here" in err


def test_a_named_port_in_use_is_one_line(run_here: StartHere, endpoints: tuple[str, str]) -> None:
    west, east = endpoints
    host, port = west.removeprefix("tcp/").split(":")
    with socket.create_server((host, int(port))):
        tis = run_here("run", "default", *HOLD, "--set", f"hosts={{west: {west}, east: {east}}}")
        code, out, err = tis.wait()
    assert code == 3
    assert f"netem: {west}: cannot listen here: in use or not of this host" in err
    assert "Traceback" not in err + out
    assert not tis.run_dir.exists()
