"""From netem's log to traces: a real twin's log, and logs written record by record."""

import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from common.channels import Direction
from common.errors import DataError
from common.node import Record
from common.records import FATES, FateBatch
from common.runtime.playback import LogReader
from deploy.cli import app
from deploy.net.run_traces import run_traces
from deploy.resolve import resolve
from deploy.twin import build_sides, run_twin
from tests.deploy.report.hand_made import MS, fate, release, write_log

OF_A_RUN = {"scenario.yaml": b"{}"}


def _log(run_dir: Path, *records: Record, attachments: Mapping[str, bytes] = OF_A_RUN) -> Path:
    write_log(run_dir, "netem", records, None, attachments)
    return run_dir


@pytest.fixture(scope="module")
def twin(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """6 s of a delay of 30 to 50 ms and of 10 % loss there, of 5 ms back."""
    path = tmp_path_factory.mktemp("twin")
    forward = "{delay: {kind: uniform, low_ms: 30, high_ms: 50}, loss: {kind: bernoulli, p_loss: 0.1}}"
    settings = [f"network.forward={forward}", "network.feedback={delay: {kind: constant, delay_ms: 5}}"]
    scenario = resolve("default", settings, None, 6.0)
    nodes, models, _ = build_sides(scenario)
    run_twin(scenario, nodes, models, path)
    return path


def test_the_trace_of_a_real_twin_is_what_its_log_says(twin: Path) -> None:
    """Oracle: the busiest key's records as plain JSON, packet by packet, without the loader."""
    found = run_traces(twin)
    assert set(found) == {"forward", "feedback"}
    assert set(found["feedback"].delay_ns.tolist()) == {5 * MS}
    trace = found["forward"]
    key = trace.label.rpartition(": ")[2]
    expected = []
    for topic, message in LogReader(twin / "netem.mcap").messages():
        if topic == FATES:
            batch = FateBatch.model_validate_json(message.data)
            if batch.direction == "forward" and batch.key == key:
                rows = zip(batch.offered_ns, batch.delay_ns, batch.outcome, strict=True)
                expected += [(at_ns, ns if how == "deliver" else -1) for at_ns, ns, how in rows]
    expected.sort()
    first_ns = expected[0][0]
    assert len(expected) == 180
    assert list(zip((trace.sent_ns + first_ns).tolist(), trace.delay_ns.tolist(), strict=True)) == expected
    assert 0.03 < np.mean(trace.delay_ns < 0) < 0.2


def test_the_command_fits_a_real_twin(twin: Path, tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["net", "fit", str(twin), "-o", str(tmp_path / "fitted.yaml")])
    assert done.exit_code == 0, done.output
    assert (tmp_path / "fitted.yaml").exists()


def test_delays_are_the_realised_ones_and_what_was_dropped_is_lost(tmp_path: Path) -> None:
    """0 left, 2 left with a copy that left earlier, 3 was overtaken and dropped, 5 is still held."""
    outcomes = ("deliver", "loss", "deliver", "deliver", "outage", "deliver")
    records = [fate("k", i, 100 * (i + 1), 1, how) for i, how in enumerate(outcomes)]  # type: ignore[arg-type]
    records += [
        release("k", 0, 100, 140, 150),
        release("k", 2, 300, 320, 320, copy_index=1),
        release("k", 2, 300, 380, 390),
        release("k", 3, 400, 410, 420, departure="late"),
    ]
    found = run_traces(_log(tmp_path, *records))
    assert list(found) == ["forward"]
    assert (found["forward"].sent_ns // MS).tolist() == [0, 100, 200, 300, 400]
    assert found["forward"].delay_ns.tolist() == [50 * MS, -1, 90 * MS, -1, -1]


def _two_keys(foreign_key: str = "c") -> list[Record]:
    records = [fate("a", 0, 10, 1), release("a", 0, 10, 11, 11)]
    records += [fate("b", 0, 20, 5), release("b", 0, 20, 25, 25), fate("b", 1, 30, None, "loss")]
    for i in range(3):
        at_ms = 20 + 10 * i
        records += [
            fate(foreign_key, i, at_ms, 7, foreign=True),
            release(foreign_key, i, at_ms, at_ms + 7, at_ms + 7, foreign=True),
        ]
    return records


def test_the_busiest_key_stands_for_its_direction_and_in_a_run_foreign_messages_for_nothing(tmp_path: Path) -> None:
    assert run_traces(_log(tmp_path, *_two_keys()))["forward"].delay_ns.tolist() == [5 * MS, -1]


@pytest.mark.parametrize("key", ["c", "b"])
def test_between_other_applications_all_messages_count(tmp_path: Path, key: str) -> None:
    """Foreign messages have numbers of their own, also where they share a key with ours."""
    found = run_traces(_log(tmp_path, *_two_keys(key), attachments={"network.yaml": b"{}"}))
    assert found["forward"].delay_ns.tolist() == [7 * MS] * 3


def test_a_sender_that_begins_again_uses_its_numbers_again(tmp_path: Path) -> None:
    records = [fate("k", 0, 10, 1), release("k", 0, 10, 11, 11), fate("k", 0, 50, 2), release("k", 0, 50, 52, 52)]
    assert run_traces(_log(tmp_path, *records))["forward"].delay_ns.tolist() == [1 * MS, 2 * MS]


@pytest.mark.parametrize("outcome", ["loss", "outage"])
def test_a_run_in_which_nothing_was_delivered_has_nothing_to_fit(tmp_path: Path, outcome: str) -> None:
    _log(tmp_path, fate("k", 0, 1, None, outcome))  # type: ignore[arg-type]
    with pytest.raises(DataError, match="must have messages of the testbed that netem delivered"):
        run_traces(tmp_path)


def test_each_direction_has_its_own_trace(tmp_path: Path) -> None:
    records = []
    ways: tuple[Direction, ...] = ("forward", "feedback")
    for way, delay_ms in zip(ways, (3, 4), strict=True):
        records += [
            fate("k", 0, 1, delay_ms, direction=way),
            release("k", 0, 1, 1 + delay_ms, 1 + delay_ms, direction=way),
        ]
    found = run_traces(_log(tmp_path, *records))
    assert {way: trace.delay_ns.tolist() for way, trace in found.items()} == {
        "forward": [3 * MS],
        "feedback": [4 * MS],
    }


def test_a_folder_without_a_log_is_no_run(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="is no run folder"):
        run_traces(tmp_path)


def test_a_damaged_log_is_fitted_as_far_as_it_goes_and_the_profile_says_so(twin: Path, tmp_path: Path) -> None:
    path = Path(shutil.copytree(twin, tmp_path / "cut"))
    whole = (path / "netem.mcap").read_bytes()
    (path / "netem.mcap").write_bytes(whole[: len(whole) * 2 // 3])
    traces, all_traces = run_traces(path), run_traces(twin)
    for direction, trace in traces.items():
        assert 0 < len(trace.sent_ns) < len(all_traces[direction].sent_ns)
        assert trace.about["lack"].startswith("log is damaged (the file ends early")
        assert all_traces[direction].about == {}
    result = CliRunner().invoke(app, ["net", "fit", str(path), "-o", str(tmp_path / "p.yaml")])
    assert result.exit_code == 0
    assert result.stderr.count("log is damaged (the file ends early") == 1
    assert "log is damaged" in (tmp_path / "p.yaml").read_text()
