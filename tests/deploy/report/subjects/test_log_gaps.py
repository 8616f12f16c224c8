"""Damaged logs: the network has not lost what a log no longer tells of. Ten seconds, a message a second each way."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from tests.deploy.report.hand_made import (
    COMMAND,
    ESTIMATED,
    ONE_CLOCK,
    a_scenario,
    answer,
    crossing,
    cut_log,
    fate,
    message,
    write_log,
)
from tests.deploy.report.partial import causes
from tis.common.channels import Direction, Side
from tis.common.node import Record
from tis.common.runtime.mcap_log import McapLog
from tis.deploy.logs.coverage import FOREVER
from tis.deploy.logs.log_paths import recovered_name
from tis.deploy.logs.read.load import RunLogs, load_run
from tis.deploy.logs.recover import recover
from tis.deploy.report.subjects.logs import LogGaps
from tis.deploy.report.subjects.measured_values import OneWay
from tis.deploy.report.subjects.network.link_figures import Link
from tis.deploy.report.subjects.network.link_summary import link_summary

S = 1_000_000_000
N = 10
LOST = 2


def _logs() -> dict[Side, list[Record]]:
    """Return what each side logs: forward, message 2 is lost in netem; every crossing takes 11 ms."""
    logs: dict[Side, list[Record]] = {"surgeon": [], "netem": [], "patient": []}
    for k in range(N):
        at_ms = 1000.0 * k
        logs["surgeon"].append(message(COMMAND, k, at_ms))
        logs["netem"] += [fate(COMMAND, k, at_ms, None, "loss")] if k == LOST else crossing(COMMAND, k, at_ms)
        if k != LOST:
            logs["patient"].append(message(COMMAND, k, at_ms, log_ms=at_ms + 11))
        logs["patient"].append(answer(k, at_ms + 20, at_ms))
        logs["netem"] += crossing(ESTIMATED, k, at_ms + 20, "feedback")
        logs["surgeon"].append(answer(k, at_ms + 20, at_ms, log_ms=at_ms + 31))
    return {side: sorted(records, key=lambda record: record.log_ns) for side, records in logs.items()}


def _run(path: Path, damaged: Side, n_whole: int) -> RunLogs:
    for side, records in _logs().items():
        own: Sequence[Record] = records if side == "netem" else [ONE_CLOCK, *records]
        if side == damaged:
            cut_log(path, side, own, n_whole)
        else:
            write_log(path, side, own)
    return load_run(path)


def _link(logs: RunLogs, direction: Direction) -> Link:
    link, problems = link_summary(logs, direction, a_scenario())
    assert problems == []
    return link


@pytest.mark.parametrize("damaged", ["surgeon", "netem", "patient"])
@pytest.mark.parametrize("n_whole", [8, 11, 15])
def test_what_a_cut_log_does_not_tell_is_not_lost(tmp_path: Path, damaged: Side, n_whole: int) -> None:
    logs = _run(tmp_path, damaged, n_whole)
    for direction in ("forward", "feedback"):
        link = _link(logs, direction)
        assert link["unplanned_loss"] == link["held_at_end"] == 0
        assert 0 < link["sent"] < N
        assert link["sent"] + link["untold"] == N
        assert not any("vanished" in text for text in link["verdict"]["violations"])
        assert link["foreign"] == 0
        n_lost = int(direction == "forward" and link["sent"] > LOST)
        assert link["loss_pct"] == pytest.approx(100 * n_lost / link["sent"])
        assert link["received"] == link["sent"] - n_lost
        crossings = OneWay.of(logs, direction, "tis")
        assert crossings is not None
        # what netem's log tells is not needed from end to end
        assert crossings.lost.sum() == (direction == "forward" and len(crossings.lost) > LOST)
        if damaged == "netem":
            assert len(crossings.lost) == N


def test_a_hole_in_the_middle_leaves_both_ends(tmp_path: Path) -> None:
    """The chunk of the arrival of 4 s is torn out: messages 3 to 5 lie within half a second of the hole."""
    for side, records in _logs().items():
        write_log(tmp_path, side, records)
    path = tmp_path / "patient.mcap"
    path.unlink()
    with McapLog(path, {"side": "patient"}) as log:
        for record in [ONE_CLOCK, *_logs()["patient"]]:
            if record.topic == COMMAND and record.seq == 4:
                at = path.stat().st_size
            log.record(record)
            log.flush()
    data = path.read_bytes()
    path.write_bytes(data[: at + 60] + bytes(4) + data[at + 64 :])
    found = recover(path, recovered_name(path))
    assert found.unknown == ((3_020_000_000, 4_020_000_000),)
    logs = load_run(tmp_path)
    link = _link(logs, "forward")
    assert (link["sent"], link["untold"], link["lost"], link["unplanned_loss"]) == (8, 2, 1, 0)
    back = _link(logs, "feedback")
    assert (back["sent"], back["untold"], back["unplanned_loss"]) == (8, 2, 0)
    (problem,) = logs.problems()
    assert causes([problem])[0].endswith("nothing is known from 3.020 to 4.020 s, and figures leave that out")


def test_an_empty_log_tells_nothing_as_a_missing_one(tmp_path: Path) -> None:
    for side, records in _logs().items():
        write_log(tmp_path, side, records)
    (tmp_path / "patient.mcap").write_bytes(b"")
    logs = load_run(tmp_path)
    link = _link(logs, "forward")
    assert (link["received"], link["unplanned_loss"], link["lost_after_netem"]) == (None, None, None)
    assert (link["sent"], link["lost"], link["untold"]) == (N, 1, 0)
    assert OneWay.of(logs, "forward", "tis") is None


def test_messages_in_flight_when_a_log_ended_are_left_out() -> None:
    """With a longest delay of 3 s, who was sent less than 3.5 s before the end may have arrived behind it."""
    gaps = LogGaps([(((10 * S, FOREVER),), 3 * S)])
    assert gaps.affect(np.array([0, 6, 7, 20]) * S).tolist() == [False, False, True, True]
    assert gaps.affected(
        (np.array([5, 6]), np.array([0, 9 * S])), (np.array([6, 8]), np.array([9, 11]) * S)
    ).tolist() == [
        6,
        8,
    ]
    assert LogGaps([]).affected((np.array([5]), np.array([0]))).tolist() == []
