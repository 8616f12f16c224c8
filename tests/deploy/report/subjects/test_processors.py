"""What the sides noted of their processors, from logs by hand to the problems of a summary."""

import json
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from tests.deploy.report.hand_made import (
    COMMAND,
    ONE_CLOCK,
    a_scenario,
    cut_log,
    fate,
    release,
    tick,
    write_log,
    write_run,
)
from tests.deploy.report.partial import causes
from tis.common.errors import DataError
from tis.common.host_records import CLOCK, PROCESSORS, ClockNote, ProcessorNote
from tis.common.node import Record
from tis.deploy.logs.read.frame import Frame
from tis.deploy.logs.read.load import RunLogs, load_run
from tis.deploy.logs.read.side_log import SideLog
from tis.deploy.report.subjects.network.link_summary import link_summary
from tis.deploy.report.subjects.processors import processors_summary, shares_of
from tis.deploy.report.summarise import build_summary

S = 1_000_000_000


def noted(own_s: float, busy_s: float, idle_s: float, steal_s: float | None = 0) -> Record:
    """Ten seconds of two processors."""
    note = ProcessorNote(
        from_ns=0, to_ns=10 * S, processors="0-1", own_ns=round(own_s * S), busy_ns=round(busy_s * S),
        idle_ns=round(idle_s * S), iowait_ns=0, steal_ns=None if steal_s is None else round(steal_s * S),
    )  # fmt: skip
    return Record(PROCESSORS, 10 * S, note)


def test_sides_of_one_host_are_not_other_programs_to_each_other(tmp_path: Path) -> None:
    logs = write_run(tmp_path, [noted(1, 8, 12)], [noted(2, 8, 12)], [noted(3, 8, 12)])
    found = processors_summary(logs)
    for each, own_pct in zip(found.values(), (10, 20, 30), strict=True):
        assert each is not None
        json.dumps(each.as_json(), allow_nan=False)
        assert each.own_pct == pytest.approx(own_pct)
        assert [each.testbed_pct, each.others_pct] == pytest.approx([30, 10])


def test_sides_of_other_hosts_have_other_processors(tmp_path: Path) -> None:
    far = ClockNote(boot_id="far", reference_boot_id="n", shared=False, epoch_ns=0, reference_epoch_ns=0)
    near = replace(far, boot_id="n", shared=True)
    write_log(tmp_path, "surgeon", [Record(CLOCK, 0, far), noted(1, 8, 12)])
    write_log(tmp_path, "netem", [noted(2, 8, 12)])
    write_log(tmp_path, "patient", [Record(CLOCK, 0, near), noted(3, 8, 12)])
    found = processors_summary(load_run(tmp_path))
    assert [each and each.testbed_pct for each in found.values()] == pytest.approx([5, 25, 25])


def test_old_logs_and_virtual_time_have_none(tmp_path: Path) -> None:
    assert processors_summary(write_run(tmp_path)) == {"surgeon": None, "netem": None, "patient": None}
    assert processors_summary(RunLogs(tmp_path)) == {"surgeon": None, "netem": None, "patient": None}


def test_where_a_side_was_cut_short_nobody_can_tell_its_work_from_others(tmp_path: Path) -> None:
    write_run(tmp_path, [noted(1, 8, 8, 4)], [noted(2, 8, 8, 4)])
    cut_log(tmp_path, "patient", [ONE_CLOCK, tick(0, 0, 1), noted(3, 8, 8, 4)], 2)
    found = processors_summary(load_run(tmp_path))
    assert found["patient"] is None
    assert found["netem"] is not None
    assert found["netem"].others_pct is None
    assert found["netem"].steal_pct == pytest.approx(20)


def test_a_standalone_netem_has_no_mates(tmp_path: Path) -> None:
    write_log(tmp_path, "netem", [noted(2, 8, 12)])
    logs = load_run(tmp_path)
    shares = shares_of(RunLogs(tmp_path, {"netem": logs.sides["netem"]}), "netem")
    assert shares is not None
    assert [shares.testbed_pct, shares.others_pct] == pytest.approx([10, 30])


def test_a_note_of_another_version_is_said_to_be_one(tmp_path: Path) -> None:
    old = Frame.of(None)
    old.extend([{"from_ns": 0}])
    log = SideLog("netem", rows={PROCESSORS: old})
    with pytest.raises(DataError, match="/tis/processors: holds records that this version does not know"):
        shares_of(RunLogs(tmp_path, {"netem": log}), "netem")


def _late(n: int = 200) -> list[Record]:
    crossings = [(fate(COMMAND, k, k, 5), release(COMMAND, k, k, k + 5, k + 17)) for k in range(n)]
    return [record for pair in crossings for record in pair]


def test_a_starved_link_says_whose_fault_it_was(tmp_path: Path) -> None:
    late = "links.forward: starved: 1 % of 200 packets left netem more than 12 ms late, allowed are 5 ms"
    late += "; late ones left from 0.02 s to 0.22 s, the worst at 0.02 s"
    steal = "; meanwhile the virtual machine's host took 26 % of the processors' time"
    for note, clause in (([noted(1, 4, 10.8, 5.2)], steal), ([], "")):
        logs = write_run(tmp_path, [noted(0.1, 4, 16)], [*_late(), *note], [noted(0.1, 4, 16)])
        _, problems = link_summary(logs, "forward", a_scenario())
        assert causes(problems) == [late + clause]


def test_missed_ticks_say_whose_fault_they_were_on_their_own_host(tmp_path: Path) -> None:
    ticks = [tick(0, 15, 15.1), tick(1, 48, 90, missed=True), tick(2, 82, 83)]
    calm, busy = noted(0.1, 0.3, 19.7), noted(0.1, 18, 2)
    write_log(tmp_path, "netem", [])
    for side, note, host in (("surgeon", busy, "a"), ("patient", calm, "b")):
        clock = ClockNote(boot_id=host, reference_boot_id="n", shared=False, epoch_ns=0, reference_epoch_ns=0)
        write_log(tmp_path, side, [Record(CLOCK, 0, clock), *ticks, note])  # type: ignore[arg-type]
    summary: dict[str, Any] = build_summary(load_run(tmp_path), a_scenario(), (), "live", 0, "")
    found = [text for text in causes(summary["problems"]) if "too busy" in text]
    assert found == [
        "ticks: 1 of 3 missed, the machine is too busy, though the processors were 98 % idle over the run: not for "
        "want of them",
        "surgeon_ticks: 1 of 3 missed, the machine is too busy; meanwhile other programs used 90 % of the "
        "processors' time",
    ]
    assert summary["processors"]["surgeon"]["others_pct"] == pytest.approx(89.5)
