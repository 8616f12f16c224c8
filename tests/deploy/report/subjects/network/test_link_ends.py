"""What the patient's gate refused was delivered: told from netem's log, from hand-made logs."""

from collections.abc import Sequence
from pathlib import Path

from tests.deploy.report.hand_made import COMMAND, MS, a_scenario, crossing, fate, message, release, write_run
from tis.common.node import Record
from tis.common.safety_records import QUARANTINE, QuarantineNote
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.report.subjects.measured_values import OneWay
from tis.deploy.report.subjects.network.link_ends import refused_arrivals
from tis.deploy.report.subjects.network.link_figures import Link
from tis.deploy.report.subjects.network.link_summary import link_summary
from tis.deploy.report.validity import why_unscored


def _refused(seq: int, recv_ms: float, kind: str = "speed") -> Record:
    note = QuarantineNote(
        key=COMMAND, seq=seq, recv_ns=round(recv_ms * MS), sample_ns=0, x_m=0.0, y_m=0.0, z_m=0.0, kind=kind
    )
    return Record(QUARANTINE, note.recv_ns, note)


def _sent(n: int) -> list[Record]:
    return [message(COMMAND, k, 10 * k) for k in range(n)]


def _crossings(*seqs: int) -> list[Record]:
    return [record for k in seqs for record in crossing(COMMAND, k, 10 * k)]


def _used(*seqs: int) -> list[Record]:
    return [message(COMMAND, k, 10 * k, log_ms=10 * k + 10) for k in seqs]


def _delivered(logs: RunLogs) -> list[tuple[int, int]]:
    found = refused_arrivals(logs, "forward", "tis").get(COMMAND)
    return [] if found is None else [(row["seq"], row["log_ns"] // MS) for row in found]


def _books(logs: RunLogs) -> Link:
    link, problems = link_summary(logs, "forward", a_scenario(network={"forward": {"delay": {
        "kind": "constant", "delay_ms": 10}}}))  # fmt: skip
    assert problems == []
    return link


def test_a_network_that_delivered_what_the_gate_refused_is_faithful_and_lost_nothing(tmp_path: Path) -> None:
    patient = [*_used(0, 1), _refused(2, 30), _refused(3, 40), *_used(4)]
    logs = write_run(tmp_path, _sent(5), _crossings(*range(5)), patient)
    link = _books(logs)
    assert (link.received, link.not_used) == (5, 2)
    assert (link.unplanned_loss, link.lost_after_netem, link.duplicated, link.reordered) == (0, 0, 0, 0)
    assert link.verdict.violations == []
    one_way = OneWay.of(logs, "forward", "tis")
    assert one_way is not None
    assert not one_way.lost.any()
    assert (one_way.one_way_ns // MS).tolist() == [10] * 5


def test_a_gate_that_refuses_all_is_why_no_tick_is_scored(tmp_path: Path) -> None:
    logs = write_run(tmp_path, _sent(3), _crossings(*range(3)), [_refused(k, 10 * k + 10) for k in range(3)])
    assert why_unscored(logs, a_scenario()) == "the patient's gate refused all 3 messages that reached it"


def test_what_is_neither_used_nor_refused_did_vanish(tmp_path: Path) -> None:
    logs = write_run(tmp_path, _sent(3), _crossings(0, 1, 2), [*_used(0), _refused(1, 20)])
    link = _books(logs)
    assert (link.received, link.not_used, link.unplanned_loss) == (2, 1, 1)
    assert any("1 of 3 messages vanished" in text for text in link.verdict.violations)


def test_forged_messages_deliver_nothing(tmp_path: Path) -> None:
    """Number 1 was lost in netem, 2 was used, 9 was never sent: what is refused under these numbers was forged."""
    netem = [*_crossings(0, 2), fate(COMMAND, 1, 10, None, "loss")]
    forged = [_refused(1, 20), _refused(2, 25, "place"), _refused(2, 35, "conflicting"), _refused(9, 40)]
    logs = write_run(tmp_path, _sent(3), netem, [*_used(0, 2), *forged])
    assert _delivered(logs) == []
    link = _books(logs)
    assert (link.received, link.not_used, link.lost) == (2, 0, 1)
    one_way = OneWay.of(logs, "forward", "tis")
    assert one_way is not None
    assert one_way.lost.tolist() == [False, True, False]


def test_a_message_with_flipped_bits_is_rejected_and_not_delivered(tmp_path: Path) -> None:
    netem = [fate(COMMAND, 0, 0, 10, flipped=3), release(COMMAND, 0, 0, 10, 10)]
    logs = write_run(tmp_path, _sent(1), netem, [_refused(0, 10)])
    assert _delivered(logs) == []
    link, _ = link_summary(logs, "forward", a_scenario())
    assert (link.corrupted_rejected, link.not_used, link.unplanned_loss) == (1, 0, 0)


def test_copies_that_netem_made_are_refused_one_by_one(tmp_path: Path) -> None:
    netem = [fate(COMMAND, 0, 0, 10, copies=1), *(release(COMMAND, 0, 0, 10, 10, copy_index=i) for i in (0, 1))]
    both: Sequence[Record] = [_refused(0, 10), _refused(0, 11), _refused(0, 12)]
    assert _delivered(write_run(tmp_path, _sent(1), netem, both)) == [(0, 10), (0, 11)]
    logs = write_run(tmp_path, _sent(1), netem, [_refused(0, 9), *_used(0)])
    assert _delivered(logs) == [(0, 9)]
    link, _ = link_summary(logs, "forward", a_scenario())
    assert (link.received, link.not_used, link.duplicated_by_netem, link.unplanned_loss) == (1, 0, 1, 0)


def test_without_netems_log_nobody_knows(tmp_path: Path) -> None:
    logs = write_run(tmp_path, _sent(1), _crossings(0), [_refused(0, 10)])
    del logs.sides["netem"]
    assert _delivered(logs) == []
