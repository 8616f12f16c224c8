"""Exchanges with netem's clock over real Zenoh sessions on loopback."""

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import closing
from typing import Any

import pytest
import zenoh

from tests.common.runtime.live_zenoh import Network, a_network, soon
from tis.common.clocks import ClockReading, Exchanges
from tis.common.errors import PeerError
from tis.common.host_records import CLOCK, EXCHANGES, ClockNote, ExchangeNote
from tis.common.node import Record
from tis.common.runtime.clock import WallClock, boot_id, monotonic_ns
from tis.common.runtime.clock_watch import ClockServer, ClockWatch
from tis.common.runtime.control import ControlKeys

pytestmark = pytest.mark.live
KEYS = ControlKeys("t")
AHEAD_NS = 3_000_000_000


@pytest.fixture
def network() -> Iterator[Network]:
    with a_network() as network:
        yield network


@pytest.fixture
def watch(network: Network) -> Iterator[ClockWatch]:
    with closing(ClockWatch(network.client, KEYS.clock)) as watch:
        yield watch


class Records(list[Record]):
    def record(self, record: Record) -> None:
        self.append(record)


Answer = Callable[[int], Any]


def another_host(received_ns: int) -> Any:
    """netem on another host, whose clock is 3 s ahead."""
    now_ns = monotonic_ns()
    return {"boot_id": "another-boot", "received_ns": received_ns + AHEAD_NS, "replied_ns": now_ns + AHEAD_NS}


def answering(network: Network, answer: Answer) -> Any:
    def reply(query: zenoh.Query) -> None:
        received_ns = monotonic_ns()
        with query:
            said = answer(received_ns)
            query.reply(KEYS.clock, said if isinstance(said, bytes) else json.dumps(said))

    return network.router.declare_queryable(KEYS.clock, reply)


def test_on_one_host_the_clock_is_shared_exactly(network: Network, watch: ClockWatch) -> None:
    """Nothing is asked any more, and the log says why."""
    log = Records()
    with ClockServer([network.router], KEYS.clock):
        watch.meet()
        assert watch.shared
        assert watch.reading() == ClockReading(0, 0)
        watch.follow(log, WallClock(5), 7)
    [record] = log
    assert record.topic == CLOCK
    boot = boot_id()
    assert record.data == ClockNote(
        boot_id=boot, reference_boot_id=boot, shared=True, epoch_ns=5, reference_epoch_ns=7
    )
    assert not any(thread.name == "clock" for thread in threading.enumerate())


def test_the_server_says_when_it_was_asked_and_when_it_answered(network: Network) -> None:
    before_ns = monotonic_ns()
    with ClockServer([network.router], KEYS.clock) as server:
        [reply] = network.client.get(KEYS.clock, timeout=2.0)
        assert reply.ok is not None
        said = json.loads(reply.ok.payload.to_bytes())
        assert before_ns < said["received_ns"] <= said["replied_ns"] < monotonic_ns()
        assert said["boot_id"] == boot_id()
        server.close()
        assert list(network.client.get(KEYS.clock, timeout=2.0)) == []


@pytest.mark.parametrize("ahead_ns", [AHEAD_NS, -86_400_000_000_000])
def test_another_hosts_clock_is_known_within_the_stated_bound(
    network: Network, watch: ClockWatch, ahead_ns: int
) -> None:
    def elsewhere(received_ns: int) -> Any:
        return {"boot_id": "b", "received_ns": received_ns + ahead_ns, "replied_ns": monotonic_ns() + ahead_ns}

    queryable = answering(network, elsewhere)
    watch.meet()
    reading = watch.reading()
    assert not watch.shared
    assert 0 < reading.bound_ns < 100_000_000
    assert abs(reading.offset_ns - ahead_ns) <= reading.bound_ns
    queryable.undeclare()


def test_exchanges_are_recorded_in_run_time_those_before_the_epoch_too(network: Network, watch: ClockWatch) -> None:
    """Each side's stamps count from its own epoch: a side whose epoch was agreed on by an exact offset sees 0."""
    log = Records()
    queryable = answering(network, another_host)
    watch.meet()
    epoch_ns = monotonic_ns()
    watch.follow(log, WallClock(epoch_ns), epoch_ns + AHEAD_NS)
    n_before = len(log)
    assert soon(lambda: len(log) >= n_before + 4)
    watch.close()
    queryable.undeclare()
    note, *records = log
    assert note.topic == CLOCK
    assert isinstance(note.data, ClockNote)
    assert not note.data.shared
    assert {record.topic for record in records} == {EXCHANGES}
    notes = [record.data for record in records]
    stamps = [
        (note.asked_ns, note.received_ns, note.replied_ns, note.answered_ns)
        for note in notes
        if isinstance(note, ExchangeNote)
    ]
    exchanges = Exchanges.of(stamps)
    assert len(exchanges) == len(records)
    assert (abs(exchanges.offset_ns) <= exchanges.bound_ns).all()
    assert exchanges.asked_ns[0] < 0 < exchanges.asked_ns[-1]


@pytest.mark.parametrize("other", ["", "none"])
def test_hosts_without_a_boot_id_do_not_share_a_clock(
    network: Network, watch: ClockWatch, monkeypatch: pytest.MonkeyPatch, other: str
) -> None:
    monkeypatch.setattr("tis.common.runtime.clock_watch.boot_id", lambda: other)
    queryable = answering(network, lambda received_ns: {**another_host(received_ns), "boot_id": ""})
    watch.meet()
    assert not watch.shared
    queryable.undeclare()


def test_equal_boot_ids_in_two_time_namespaces_are_not_one_clock(network: Network, watch: ClockWatch) -> None:
    queryable = answering(network, lambda received_ns: {**another_host(received_ns), "boot_id": boot_id()})
    watch.meet()
    assert not watch.shared
    assert abs(watch.reading().offset_ns - AHEAD_NS) <= watch.reading().bound_ns
    queryable.undeclare()


def test_a_clock_that_nobody_answers_for_is_an_error(watch: ClockWatch) -> None:
    with pytest.raises(PeerError, match="netem: t/@tis/clock: does not answer clock queries"):
        watch.meet()


JUNK: list[Any] = [
    b"", b"[]", b"{}", b"\xff", b"[" * 20_000, {"boot_id": "b", "received_ns": "soon", "replied_ns": 1},
    {"boot_id": "b", "received_ns": True, "replied_ns": 1}, {"boot_id": 1, "received_ns": 1, "replied_ns": 1},
    {"boot_id": "b", "received_ns": 1, "replied_ns": 10**30}, {"boot_id": "b", "received_ns": 2, "replied_ns": 1},
]  # fmt: skip


def test_an_answer_that_is_no_clock_counts_as_none(network: Network) -> None:
    for junk in JUNK:
        queryable = answering(network, lambda _, said=junk: said)  # type: ignore[misc]
        with (
            closing(ClockWatch(network.client, KEYS.clock)) as watch,
            pytest.raises(PeerError, match="does not answer"),
        ):
            watch.meet()
        queryable.undeclare()


def test_a_session_that_is_closed_ends_the_asking(network: Network, watch: ClockWatch) -> None:
    queryable = answering(network, another_host)
    watch.meet()
    queryable.undeclare()
    network.client.close()  # type: ignore[no-untyped-call]
    assert soon(lambda: not any(thread.name == "clock" for thread in threading.enumerate()))
