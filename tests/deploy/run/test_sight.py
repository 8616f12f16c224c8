"""Sight as a whole, in virtual time: hand to eye to the nanosecond, bit-equal, books that balance."""

from base64 import b64decode
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from tis.common.errors import InputError
from tis.common.records import COUNTERS
from tis.common.scenario import Scenario
from tis.common.scenario.reading import dump_scenario
from tis.common.sight.fragments import FRAGMENT_HEAD_BYTES
from tis.common.sight_records import CAMERA, PICTURES, SCREEN
from tis.deploy.logs.read.load import RunLogs, load_run
from tis.deploy.report.summarise import build_summary
from tis.deploy.run.replay import replay
from tis.deploy.run.replay_sight import read_logged, replay_screen, replayed_notes
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, refuse_in_virtual_time, run_twin
from tis.deploy.shell import run_dir as folder
from tis.patient_side.identification.model_file import dump_models

pytest.importorskip("PIL", reason="the extra report is not installed")

NET = "network={{forward: {{delay: {{kind: constant, delay_ms: 7}}}}, feedback: {{{}}}}}"
CONSTANT = NET.format("delay: {kind: constant, delay_ms: 11}, rate: {kbit_s: 8000, overhead_bytes: 0}")
SMALL = ("drain_s=0.3", "estimators=[hold]", "active_estimator=hold", "sight.width=320", "sight.height=240")


def _scenario(*settings: str, name: str = "sight", duration_s: float = 2.0) -> Scenario:
    return resolve(name, (*SMALL, *settings), None, duration_s)


def _twin(run_dir: Path, scenario: Scenario) -> tuple[RunLogs, dict[str, Any]]:
    folder.create(run_dir, scenario)
    nodes, models, _ = build_sides(scenario)
    run_twin(scenario, nodes, models, run_dir)
    logs = load_run(run_dir)
    return logs, build_summary(logs, scenario, models, "twin", 0, "")


def _above(ns: int, rate_hz: int, phase_ns: int) -> int:
    """Return the first instant of a grid at or after an instant."""
    k = 0
    while k * 10**9 // rate_hz + phase_ns < ns:
        k += 1
    return k * 10**9 // rate_hz + phase_ns


def test_hand_to_eye_is_the_sum_of_the_grids_and_delays_to_the_nanosecond(tmp_path: Path) -> None:
    settings = ("sight.fps=25", "sight.display_hz=144", "sight.display_phase_ms=1.5", "sight.camera_phase_ms=9")
    logs, _ = _twin(tmp_path / "run", _scenario(CONSTANT, *settings))
    sent = {row["frame"]: row for row in logs.of("patient", CAMERA)}
    shown = [row for row in logs.of("surgeon", SCREEN) if row["shown_ns"] is not None]
    assert len(shown) == len(sent) == 50
    for row in shown:
        frame, command = row["top_frame"], row["top_command"]
        assert row["state"] == "complete"
        assert (frame, command) == (row["bottom_frame"], row["bottom_command"])
        captured_ns = frame * 10**9 // 25 + 9_000_000
        # the newest command: its sample, 7 ms, the next tick, which is at or before the capture
        newest = max(
            (k for k in range(60) if _above(k * 10**9 // 30 + 7_000_000, 30, 2_000_000) <= captured_ns), default=-1
        )
        assert command == newest
        note = sent[frame]
        n_bits = 8 * (note["n_bytes"] + note["n_fragments"] * FRAGMENT_HEAD_BYTES)
        # the bits of the frame at 1 bit per 125 ns; poses share the rate, so that they may come in between
        arrived_ns = captured_ns + n_bits * 125 + 11_000_000
        assert 0 <= row["last_ns"] - arrived_ns <= 2 * 8 * 400 * 125
        assert row["shown_ns"] == _above(row["last_ns"], 144, 1_500_000)


def test_without_a_rate_the_grids_alone_tell_what_the_eye_sees(tmp_path: Path) -> None:
    logs, _ = _twin(tmp_path / "run", _scenario(NET.format("delay: {kind: constant, delay_ms: 11}")))
    for row in logs.of("surgeon", SCREEN):
        captured_ns = row["top_frame"] * 10**9 // 30 + 5_000_000
        assert row["first_ns"] == row["last_ns"] == captured_ns + 11_000_000
        assert row["shown_ns"] == _above(captured_ns + 11_000_000, 60, 0)
        # commands wait 7 ms and for the tick at 2 ms: those of the sample before the one before the frame
        assert row["top_command"] == row["top_frame"] - 1


@pytest.mark.parametrize("codec", ["jpeg", "h264"])
def test_a_twin_with_video_repeats_bit_for_bit_and_its_books_balance(tmp_path: Path, codec: str) -> None:
    if codec == "h264":
        pytest.importorskip("av", reason="the extra video is not installed")
    loss = "network.feedback.loss={kind: gilbert_elliott, p_bad: 0.02, p_good: 0.3, p_loss_bad: 0.9}"
    scenario = _scenario(f"sight.codec={codec}", loss, "sight.fragment_bytes=700", duration_s=3)
    logs, summary = _twin(tmp_path / "one", scenario)
    models = build_sides(scenario)[1]
    _twin(tmp_path / "two", scenario)
    for log in ("surgeon.mcap", "netem.mcap", "patient.mcap"):
        assert (tmp_path / "one" / log).read_bytes() == (tmp_path / "two" / log).read_bytes()
    assert summary["valid"], summary["problems"]
    counts = {row["name"]: row["value"] for side in ("surgeon", "patient") for row in logs.of(side, COUNTERS)}
    sent, received = (logs.messages(side, "feedback", "tis")["tis/ECM/video"] for side in ("patient", "surgeon"))
    assert len(sent) == counts["video_fragments"] == sum(row["n_fragments"] for row in logs.of("patient", CAMERA))
    assert len(received) == counts["video_received"] < len(sent)
    assert set(received.fingerprint) <= set(sent.fingerprint)
    states = Counter(row["state"] for row in logs.of("surgeon", SCREEN))
    assert states["complete"] > 5
    assert states["concealed"] > 0
    assert states["torn"] == 0
    (tmp_path / "one" / "model.json").write_bytes(dump_models(models))
    assert replay_screen(tmp_path / "one", scenario) == (len(logs.of("surgeon", SCREEN)), 0, 0)
    found = replay(tmp_path / "one")
    assert found.identical, str(found)
    pictures = load_run(tmp_path / "one", {PICTURES}).of("patient", PICTURES)
    assert [row["frame"] for row in pictures] == list(range(90))


@pytest.mark.parametrize("size", [1, 65_000])
def test_the_smallest_and_the_largest_fragments_balance(tmp_path: Path, size: int) -> None:
    network = NET.format("delay: {kind: constant, delay_ms: 5}")
    scenario = _scenario(network, f"sight.fragment_bytes={size}", "sight.quality=5", duration_s=0.3)
    logs, summary = _twin(tmp_path / "run", scenario)
    sent = logs.of("patient", CAMERA)
    assert not [text for text in summary["problems"] if "no tick could be scored" not in text]
    assert all(row["n_fragments"] == (row["n_bytes"] if size == 1 else 1) for row in sent)
    assert [row["state"] for row in logs.of("surgeon", SCREEN)] == ["complete"] * len(sent)
    assert len(sent) == 9


def test_what_the_network_does_to_fragments_is_counted_and_no_torn_frame_passes(tmp_path: Path) -> None:
    stages = (
        "delay: {kind: uniform, low_ms: 5, high_ms: 30}, duplicate: {p_duplicate: 0.1}, ordering: reorder, "
        "corrupt: {p_corrupt: 0.02}"
    )
    logs, _ = _twin(tmp_path / "run", _scenario(NET.format(stages), "sight.fragment_bytes=200"))
    counts = {row["name"]: row["value"] for row in logs.of("surgeon", COUNTERS)}
    assert min(counts[f"video_{kind}"] for kind in ("duplicated", "reordered", "corrupted")) > 0
    assert counts["video_forged"] == 0
    rows = logs.of("surgeon", SCREEN)
    assert len(rows) == 60
    for row in rows:
        assert row["state"] != "torn"
        if row["state"] == "complete":
            assert row["top_frame"] == row["bottom_frame"] == row["frame"]
            assert row["missing"] == ""


def test_a_refresh_that_ctrl_c_prevented_is_not_replayed(tmp_path: Path) -> None:
    """The last frame of a live run was decoded, and its refresh due, when the loop ended without it."""
    scenario = _scenario("sight.codec=jpeg", duration_s=1)
    _twin(tmp_path / "one", scenario)
    pictures = load_run(tmp_path / "one", {PICTURES}).of("patient", PICTURES)
    sent = {row["frame"]: (row["captured_ns"], b64decode(row["data"])) for row in pictures}
    logged = read_logged(tmp_path / "one" / "surgeon.mcap", scenario)
    *others, last = logged.notes
    for known in (last, replace(last, shown_ns=None)):
        *_, found = replayed_notes(logged._replace(notes=[*others, known]), scenario, sent)
        assert found == known
    assert last.shown_ns is not None


def test_sight_that_cannot_be_is_refused() -> None:
    with pytest.raises(InputError) as refused:
        _scenario("sight.camera_phase_ms=40", "sight.width=330", "sight.fragment_bytes=65001")
    found = " ".join(map(str, refused.value.faults))
    assert "width" in found
    assert "fragment_bytes" in found
    with pytest.raises(InputError, match=r"quality must be left out with camera external, .* \(80\)"):
        resolve("sight", ("sight={camera: external, quality: 80}",), None, None)
    with pytest.raises(InputError, match=r"sight\.camera: must be drawn in virtual time"):
        refuse_in_virtual_time(resolve("sight", ("sight.camera=external",), None, None))
    with pytest.raises(InputError, match="camera_phase_ms must be less than one period"):
        _scenario("sight.camera_phase_ms=40")
    assert "sight" not in dump_scenario(resolve("default", (), None, None))


def test_touch_and_sight_share_a_network(tmp_path: Path) -> None:
    scenario = _scenario("identification.train_samples=500", name="touch_and_sight", duration_s=3)
    logs, summary = _twin(tmp_path / "run", scenario)
    assert summary["valid"], summary["problems"]
    assert {row["state"] for row in logs.of("surgeon", SCREEN)} == {"complete"}
    assert len({row["left_y"] for row in logs.of("patient", CAMERA)}) > 5
