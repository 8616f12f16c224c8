"""From netem's log to records: a real twin's log, and logs written record by record."""

import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs
from typer.testing import CliRunner

from tests.deploy.hold_only import HOLD
from tests.deploy.report.hand_made import MS, a_scenario, fate, release, write_log
from tests.log_reader import LogReader
from tis.common.channels import Direction
from tis.common.errors import DataError, InputError
from tis.common.messages import decode
from tis.common.node import Record
from tis.common.records import CONTROL, FATES, ControlNote, FateBatch
from tis.common.scenario.reading import dump_scenario
from tis.deploy.cli.main import app
from tis.deploy.net.profiles import find_profile
from tis.deploy.net.run_records import run_records
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, run_twin
from tis.netem.fit.direction import fit_direction
from tis.netem.fit.record import Flips

RUN_HEADER_FIELDS = {"scenario.yaml": dump_scenario(a_scenario(1.0)).encode()}

LIGHT = (*HOLD, "identification={order: 2, block_rows: 3, train_samples: 240}")
"""For twins whose estimates are not looked at."""

WAYS: tuple[Direction, ...] = ("forward", "feedback")


def _log(run_dir: Path, *records: Record, attachments: Mapping[str, bytes] = RUN_HEADER_FIELDS) -> Path:
    write_log(run_dir, "netem", records, None, attachments)
    return run_dir


@pytest.fixture(scope="module")
def twin(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """6 s of a delay of 30 to 50 ms and of 10 % loss there, of 5 ms back."""
    path = tmp_path_factory.mktemp("twin")
    forward = "{delay: {kind: uniform, low_ms: 30, high_ms: 50}, loss: {kind: bernoulli, p_loss: 0.1}}"
    settings = [f"network.forward={forward}", "network.feedback={delay: {kind: constant, delay_ms: 5}}", *LIGHT]
    scenario = resolve("default", settings, None, 6.0)
    nodes, models, _ = build_sides(scenario)
    run_twin(scenario, nodes, models, path)
    return path


def test_the_trace_of_a_real_twin_is_what_its_log_says(twin: Path) -> None:
    """Oracle: the busiest key's records as plain JSON, packet by packet, without the loader."""
    found = run_records(twin)
    assert set(found) == {"forward", "feedback"}
    assert set(found["feedback"].trace.delay_ns.tolist()) == {5 * MS}
    trace = found["forward"].trace
    key = trace.label.rpartition(": ")[2]
    expected = []
    for topic, message in LogReader(twin / "netem.mcap").messages():
        if topic == FATES:
            batch = decode(message.data, FateBatch)
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


def test_delays_are_the_decided_ones_and_what_outages_dropped_is_left_out(tmp_path: Path) -> None:
    """0 left, 2 left with a copy that left earlier, 3 was overtaken and dropped, 5 is still held, its delay known."""
    outcomes = ("deliver", "loss", "deliver", "deliver", "outage", "deliver")
    copies = (0, 0, 1, 0, 0, 0)
    records = [
        fate("k", i, 100 * (i + 1), 40 + i, how, copies=n, flipped=3 * (i == 3))  # type: ignore[arg-type]
        for i, (how, n) in enumerate(zip(outcomes, copies, strict=True))
    ]
    records += [
        release("k", 0, 100, 140, 150),
        release("k", 2, 300, 320, 320, copy_index=1),
        release("k", 2, 300, 380, 390),
        release("k", 3, 400, 410, 420, departure="late"),
    ]
    found = run_records(_log(tmp_path, *records))
    assert list(found) == ["forward"]
    record = found["forward"]
    assert (record.trace.sent_ns // MS).tolist() == [0, 100, 200, 300, 500]
    assert record.trace.delay_ns.tolist() == [40 * MS, -1, 42 * MS, 43 * MS, 45 * MS]
    assert record.left_out == ("1 dropped by outages, which the loss stage does not cover",)
    assert (record.n_copied, record.flips, record.n_dropped_late, record.overtaken) == (1, Flips(1, 3), 1, 0.0)
    assert (
        "netem let messages go 10 ms later at p99, which is not in the delays" in record.trace.about["release_error"]
    )


def test_the_queue_of_a_rate_counts_and_who_still_waits_in_it_is_left_out(tmp_path: Path) -> None:
    """1 was dropped by CoDel, 2 by the buffer, 3 waits: what was decided has no instant yet."""
    records = [_queued(i) for i in range(4)]
    records += [
        release("k", 0, 100, 117, 117, queued_ms=7),
        release("k", 1, 200, 0, 0, departure="codel"),
        release("k", 2, 300, 0, 0, departure="evicted"),
    ]
    record = run_records(_log(tmp_path, *records))["forward"]
    assert record.trace.delay_ns.tolist() == [17 * MS, -1]
    assert record.left_out == (
        "1 that netem's own buffer had no room for",
        "1 still in a queue when the log ended",
    )


def _queued(i: int) -> Record:
    of = fate("k", i, 100 * (i + 1), 10)
    assert isinstance(of.data, FateBatch)
    return structs.replace(of, data=structs.replace(of.data, release_ns=(0,)))


CHANGE = '[{"at_s": 0.3, "for_s": 0.2, "direction": "forward", "set": {"add_delay_ms": 50}}]'


@pytest.mark.parametrize("accepted", [True, False])
def test_what_was_offered_under_a_change_by_hand_is_left_out(tmp_path: Path, accepted: bool) -> None:
    """One each 100 ms from 100 on; the change holds from 300 to 500."""
    note = ControlNote(at_ns=250 * MS, applied_ns=300 * MS, request="{}", added=CHANGE, accepted=accepted)
    records: list[Record] = [Record(CONTROL, note.at_ns, note)]
    records += [fate("k", i, 100 * i, 60 if 3 <= i < 5 else 10, direction=way) for way in WAYS for i in range(1, 8)]
    found = run_records(_log(tmp_path, *records))
    delays = {way: (record.trace.delay_ns // MS).tolist() for way, record in found.items()}
    assert delays["feedback"] == [10, 10, 60, 60, 10, 10, 10]
    assert delays["forward"] == ([10] * 5 if accepted else delays["feedback"])
    said = "2 offered while the timeline or `tis net` changed the network"
    assert found["forward"].left_out == ((said,) if accepted else ())


def test_an_outage_and_a_timeline_change_nothing_in_the_fit_of_what_holds_else(tmp_path: Path) -> None:
    """Of 60 s an outage takes 6, an entry of +50 ms 15: independent losses of 5 % stay, and 20 to 30 ms."""
    settings = [
        "network.forward={delay: {kind: uniform, low_ms: 20, high_ms: 30}, loss: {kind: bernoulli, p_loss: 0.05}}",
        "network.forward.duplicate={p_duplicate: 0.1}",
        "network.timeline=[{at_s: 30, for_s: 15, set: {add_delay_ms: 50}}]",
        "network.outages=[{kind: periodic, every_s: 20, for_s: 2, first_s: 10}]",
        *LIGHT,
    ]
    scenario = resolve("default", settings, None, 60.0)
    nodes, models, _ = build_sides(scenario)
    run_twin(scenario, nodes, models, tmp_path)
    record = run_records(tmp_path)["forward"]
    fit = fit_direction(record)
    assert {line.partition(" ")[2] for line in record.left_out} == {
        "dropped by outages, which the loss stage does not cover",
        "offered while the timeline or `tis net` changed the network",
        "of other keys than tis/MTML/measured_cp: tis/PSM2/setpoint_cp (1800); --key fits one of them",
    }
    assert fit.stages["delay"]["kind"] == "uniform"
    assert fit.stages["delay"]["low_ms"] == pytest.approx(20, abs=0.1)
    assert fit.stages["delay"]["high_ms"] == pytest.approx(30, abs=0.1)
    assert fit.stages["loss"] == {"kind": "bernoulli", "p_loss": pytest.approx(0.05, abs=0.02)}
    assert fit.stages["duplicate"]["p_duplicate"] == pytest.approx(0.1, abs=0.03)
    assert "correlation" not in fit.stages


def test_states_are_one_network_and_that_is_said(tmp_path: Path) -> None:
    states = {"kind": "script", "states": [{"name": "bad"}], "steps": [{"at_s": 0.5, "state": "bad"}]}
    scenario = a_scenario(1.0, network={"states": states})
    attachments = {"scenario.yaml": dump_scenario(scenario).encode()}
    record = run_records(_log(tmp_path, fate("k", 0, 100, 1), fate("k", 1, 900, 2), attachments=attachments))[
        "forward"
    ]
    assert record.trace.delay_ns.tolist() == [MS, 2 * MS]
    assert record.trace.about["states"] == "the states bad are fitted as one network"


def test_a_direction_with_too_few_messages_is_left_out_and_said(tmp_path: Path) -> None:
    records = [fate("k", i, 10 * i, 5) for i in range(40)]
    records += [fate("k", i, 10 * i, 5, direction="feedback") for i in range(3)]
    _log(tmp_path, *records)
    result = CliRunner().invoke(app, ["net", "fit", str(tmp_path), "-o", str(tmp_path / "p.yaml")])
    assert result.exit_code == 0, result.output
    said = "must have at least 30 messages that arrived, has 3"
    assert result.stderr.startswith("warning: feedback: left out of the profile")
    assert said in result.stderr
    profile = find_profile(str(tmp_path / "p.yaml"))
    assert profile.network.forward.delay is not None
    assert profile.network.feedback.delay is None
    assert said in profile.notes


def test_a_run_with_too_few_messages_makes_no_profile(tmp_path: Path) -> None:
    _log(tmp_path, *(fate("k", i, 10 * i, 5) for i in range(3)))
    result = CliRunner().invoke(app, ["net", "fit", str(tmp_path), "-o", str(tmp_path / "p.yaml")])
    assert result.exit_code == 4
    assert not (tmp_path / "p.yaml").exists()


def test_a_log_that_has_lost_its_network_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"must hold network\.yaml or scenario\.yaml"):
        run_records(_log(tmp_path, fate("k", 0, 1, 1), attachments={}))


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


def test_a_direction_has_its_busiest_key_and_in_a_run_no_foreign_messages(tmp_path: Path) -> None:
    assert run_records(_log(tmp_path, *_two_keys()))["forward"].trace.delay_ns.tolist() == [5 * MS, -1]


@pytest.mark.parametrize("key", ["c", "b"])
def test_between_other_applications_all_messages_count(tmp_path: Path, key: str) -> None:
    """Foreign messages have numbers of their own, also where they share a key with ours."""
    found = run_records(_log(tmp_path, *_two_keys(key), attachments={"network.yaml": b"{}"}))
    assert found["forward"].trace.delay_ns.tolist() == [7 * MS] * 3
    assert found["forward"].key == key


def test_keys_are_fitted_apart_and_the_others_are_counted(tmp_path: Path) -> None:
    path = _log(tmp_path, *_two_keys("c"), attachments={"network.yaml": b"{}"})
    record, other = run_records(path)["forward"], run_records(path, "b")["forward"]
    assert record.left_out[-1].startswith("3 of other keys than c: b (2), a (1)")
    assert other.left_out[-1].startswith("4 of other keys than b: c (3), a (1)")
    assert (other.key, other.trace.delay_ns.tolist()) == ("b", [5 * MS, -1])
    with pytest.raises(InputError, match=r"--key: is no key of the log; c \(3\)"):
        run_records(path, "d")


def test_a_sender_that_begins_again_uses_its_numbers_again(tmp_path: Path) -> None:
    records = [fate("k", 0, 10, 1), release("k", 0, 10, 11, 11), fate("k", 0, 50, 2), release("k", 0, 50, 52, 52)]
    assert run_records(_log(tmp_path, *records))["forward"].trace.delay_ns.tolist() == [1 * MS, 2 * MS]


@pytest.mark.parametrize("outcome", ["loss", "outage"])
def test_a_run_in_which_nothing_was_delivered_has_nothing_to_fit(tmp_path: Path, outcome: str) -> None:
    _log(tmp_path, fate("k", 0, 1, None, outcome))  # type: ignore[arg-type]
    with pytest.raises(DataError, match="must have messages of the testbed that netem delivered"):
        run_records(tmp_path)


def test_each_direction_has_its_own_trace(tmp_path: Path) -> None:
    records = []
    for way, delay_ms in zip(WAYS, (3, 4), strict=True):
        records += [
            fate("k", 0, 1, delay_ms, direction=way),
            release("k", 0, 1, 1 + delay_ms, 1 + delay_ms, direction=way),
        ]
    found = run_records(_log(tmp_path, *records))
    assert {way: record.trace.delay_ns.tolist() for way, record in found.items()} == {
        "forward": [3 * MS],
        "feedback": [4 * MS],
    }


def test_a_folder_without_a_log_is_no_run(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="is no run folder"):
        run_records(tmp_path)


def test_a_damaged_log_is_fitted_as_far_as_it_goes_and_the_profile_says_so(twin: Path, tmp_path: Path) -> None:
    path = Path(shutil.copytree(twin, tmp_path / "cut"))
    whole = (path / "netem.mcap").read_bytes()
    (path / "netem.mcap").write_bytes(whole[: len(whole) * 2 // 3])
    found, whole_ones = run_records(path), run_records(twin)
    for direction, record in found.items():
        assert 0 < len(record.trace.sent_ns) < len(whole_ones[direction].trace.sent_ns)
        assert record.trace.about["lack"].startswith("log is damaged (the file ends early")
        assert "lack" not in whole_ones[direction].trace.about
    result = CliRunner().invoke(app, ["net", "fit", str(path), "-o", str(tmp_path / "p.yaml")])
    assert result.exit_code == 0
    assert result.stderr.count("log is damaged (the file ends early") == 1
    assert "log is damaged" in (tmp_path / "p.yaml").read_text()
