"""Parts of a log: which one comes next, and which earlier one it continues."""

from pathlib import Path

import pytest

from tis.common.node import Record
from tis.common.records import TICKS, TickNote
from tis.common.runtime.log_parts import (
    CLOCK_FILE,
    EarlierPart,
    PartClock,
    companion_logs,
    companion_name,
    last_part,
    n_parts,
    part_clock,
    part_name,
)
from tis.common.runtime.mcap_log import McapLog

S = 1_000_000_000
CLOCK = PartClock(epoch_monotonic_ns=5 * S, epoch_unix_ns=1000 * S, run_id=7, boot="b" * 16)


def _write(path: Path, clock: PartClock | None, n_ticks: int = 3) -> None:
    with McapLog(path, {"digest": "d"}) as log:
        log.attach("scenario.yaml", b"version: 1")
        if clock is not None:
            log.attach(CLOCK_FILE, clock.model_dump_json().encode())
        for k in range(n_ticks):
            log.record(Record(TICKS, k, TickNote(tick=k, due_ns=k, begin_ns=k)))


def test_the_parts_of_a_log_are_numbered_from_its_second() -> None:
    assert [part_name("netem", number) for number in (1, 2, 12)] == ["netem.mcap", "netem_2.mcap", "netem_12.mcap"]


def test_the_last_part_is_the_last_that_was_in_a_run(tmp_path: Path) -> None:
    assert (n_parts(tmp_path, "surgeon"), last_part(tmp_path, "surgeon")) == (0, None)
    _write(tmp_path / "surgeon.mcap", CLOCK)
    found = last_part(tmp_path, "surgeon")
    assert found == EarlierPart(tmp_path / "surgeon.mcap", "d", CLOCK)
    joined = CLOCK.model_copy(update={"joined_ns": 3 * S})
    _write(tmp_path / "surgeon_2.mcap", joined)
    _write(tmp_path / "surgeon_3.mcap", None)
    _write(tmp_path / "surgeon_5.mcap", CLOCK)
    assert n_parts(tmp_path, "surgeon") == 3
    assert last_part(tmp_path, "surgeon") == EarlierPart(tmp_path / "surgeon_2.mcap", "d", joined)


@pytest.mark.parametrize("n_bytes", [0, 3, 8, 60, 300])
def test_a_log_cut_before_its_clock_is_no_part_of_a_run(tmp_path: Path, n_bytes: int) -> None:
    path = tmp_path / "patient.mcap"
    _write(path, CLOCK)
    path.write_bytes(path.read_bytes()[:n_bytes])
    assert last_part(tmp_path, "patient") is None


def test_a_log_cut_after_its_clock_is_one(tmp_path: Path) -> None:
    path = tmp_path / "patient.mcap"
    _write(path, CLOCK)
    path.write_bytes(path.read_bytes()[:-700])
    assert last_part(tmp_path, "patient") == EarlierPart(path, "d", CLOCK)


def test_a_part_is_continued_while_its_run_can_go_on() -> None:
    part = EarlierPart(Path("surgeon.mcap"), "d", CLOCK)
    assert part.is_under_way("d", 20 * S, 1021 * S - 1)
    assert not part.is_under_way("d", 20 * S, 1021 * S)
    assert not part.is_under_way("e", 20 * S, 1001 * S)


def test_another_run_and_a_host_started_anew_are_refused_by_name() -> None:
    part = EarlierPart(Path("surgeon.mcap"), "d", CLOCK)
    assert part.why_not_continued(7, "b" * 16) is None
    assert part.why_not_continued(8, "b" * 16) == "surgeon.mcap is of another run than the one that the others are in"
    assert "before this host was started anew" in str(part.why_not_continued(7, "c" * 16))


def test_a_killed_process_leaves_a_log_without_an_end(tmp_path: Path) -> None:
    path = tmp_path / "surgeon.mcap"
    _write(path, CLOCK)
    assert not EarlierPart(path, "d", CLOCK).was_cut
    for n_bytes in (len(path.read_bytes()) - 1, 5, 0):
        path.write_bytes(path.read_bytes()[:n_bytes])
        assert EarlierPart(path, "d", CLOCK).was_cut


@pytest.mark.parametrize("data", [b"", b"{", b"[]", b'{"epoch_monotonic_ns": 1}', b'{"epoch_monotonic_ns": "x"}'])
def test_a_clock_that_cannot_be_read_is_none(data: bytes) -> None:
    assert part_clock({CLOCK_FILE: data}) is None
    assert part_clock({}) is None


def test_logs_of_camera_and_screen_lie_beside_those_of_their_sides(tmp_path: Path) -> None:
    assert [companion_name("patient", 1), companion_name("surgeon", 2)] == [
        "patient_camera.mcap", "surgeon_screen_2.mcap",
    ]  # fmt: skip
    for name in ("patient_camera.mcap", "patient_camera_2.mcap", "patient_camera_4.mcap", "patient.mcap"):
        (tmp_path / name).touch()
    assert [path.name for path in companion_logs(tmp_path, "patient")] == [
        "patient_camera.mcap",
        "patient_camera_2.mcap",
    ]
    assert companion_logs(tmp_path, "netem") == []
    assert n_parts(tmp_path, "patient") == 1
