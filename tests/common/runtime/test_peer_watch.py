"""Beats over loopback, and rows of the kernel's table of connections.

Live, a network that is taken down: tests/system/test_peers.
"""

import socket
import time

import pytest
import zenoh

from tis.common.messages import encode
from tis.common.peer_life import Beat
from tis.common.runtime import peer_watch
from tis.common.runtime.control import ControlKeys
from tis.common.runtime.ports import free_endpoints
from tis.common.runtime.zenoh_session import ZenohOptions, configure
from tis.common.signing import RunKeys


def _row(queues: str, timer: str, retransmits: str, remote: str = "0100007F:1D17") -> list[str]:
    return ["0:", "0100007F:9999", remote, "01", queues, timer, retransmits, "0", "0", "1"]


@pytest.mark.parametrize(
    ("row", "is_stuck"),
    [
        (_row("00000000:00000000", "00:00000000", "00000000"), False),
        (_row("000000C8:00000000", "01:0000000A", "00000001"), True),  # sent again
        (_row("000000C8:00000000", "01:0000000A", "00000000"), False),  # sent, not yet acknowledged
        (_row("000000C8:00000000", "04:0000000A", "00000000"), False),  # the other side's buffer is full
    ],
)
def test_a_connection_is_stuck_when_the_kernel_sends_again(row: list[str], is_stuck: bool) -> None:
    assert peer_watch._is_stuck(row) == is_stuck


def test_a_connection_is_stuck_when_the_way_is_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(peer_watch, "_has_route", lambda address: address != "020110AC:1D17")
    assert peer_watch._is_stuck(_row("000000C8:00000000", "04:0000000A", "00000000", "020110AC:1D17"))


def test_loopback_is_known_by_either_family() -> None:
    assert peer_watch._has_route("0100007F:1D17")


def test_own_connections_are_found_by_their_ports_and_none_is_not_known() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        assert peer_watch.is_retransmitting({port}) is None
        with socket.create_connection(("127.0.0.1", port)):
            assert peer_watch.is_retransmitting({port}) is False


def test_beats_of_another_run_are_not_believed_nor_passed_on() -> None:
    west, east = free_endpoints()
    keys, passed = ControlKeys("tis"), list[bytes]()
    with (
        zenoh.open(configure("router", ZenohOptions(listen=[west]))) as at_west,
        zenoh.open(configure("router", ZenohOptions(listen=[east]))) as at_east,
        zenoh.open(configure("client", ZenohOptions(connect=[west]))) as surgeon,
        zenoh.open(configure("client", ZenohOptions(connect=[east]))) as patient,
    ):
        patient.declare_subscriber(keys.beat("surgeon"), lambda sample: passed.append(sample.payload.to_bytes()))
        netem = peer_watch.Beats("netem", {"west": at_west, "east": at_east}, keys, run_id=7)
        own = Beat("surgeon", 5, 5, 7)
        heard: list[Beat] = []
        until_s = time.monotonic() + 20
        while len(heard) < 3 or len(passed) < 3:
            for beat in (Beat("surgeon", 10**10, 0, 8), Beat("surgeon", 0, 0), Beat("patient", 9, 9, 7), own):
                surgeon.put(keys.beat(beat.side), encode(beat))
            surgeon.put(keys.beat("surgeon"), encode(Beat("surgeon", 6, 6, 7)), attachment=bytes(3000))
            time.sleep(0.02)
            heard += netem.heard()
            assert time.monotonic() < until_s
        netem.close()
    assert heard == [own] * len(heard)
    assert set(passed) == {encode(own)}
    assert netem.forged == {"surgeon"}


def test_where_messages_are_signed_beats_without_a_code_or_told_again_are_refused() -> None:
    endpoint, _ = free_endpoints()
    keys, passed = ControlKeys("tis"), list[tuple[bytes, bytes]]()
    ours, theirs = RunKeys(b"p" * 32, (b"s" * 32,)), RunKeys(b"s" * 32, (b"p" * 32,))
    with (
        zenoh.open(configure("router", ZenohOptions(listen=[endpoint]))),
        zenoh.open(configure("client", ZenohOptions(connect=[endpoint]))) as at_patient,
        zenoh.open(configure("client", ZenohOptions(connect=[endpoint]))) as at_surgeon,
        zenoh.open(configure("client", ZenohOptions(connect=[endpoint]))) as mallory,
    ):

        def take(sample: zenoh.Sample) -> None:
            assert sample.attachment is not None
            passed.append((sample.payload.to_bytes(), sample.attachment.to_bytes()))

        mallory.declare_subscriber(keys.beat("surgeon"), take)
        patient = peer_watch.Beats("patient", {"east": at_patient}, keys, 7, signed=ours)
        surgeon = peer_watch.Beats("surgeon", {"west": at_surgeon}, keys, 7, signed=theirs)
        heard: list[Beat] = []
        until_s = time.monotonic() + 20
        while len(heard) < 3 or len(passed) < 3:
            surgeon.send(Beat("surgeon", 5, 5, 7))  # of a clock that stands still
            time.sleep(0.02)
            heard += patient.heard()
            assert time.monotonic() < until_s
        assert patient.forged == set()
        payload, attachment = passed[0]
        for forged, its in ((payload, attachment), (payload, None), (encode(Beat("surgeon", 9, 9, 7)), attachment)):
            time.sleep(0.1)
            patient.heard()
            patient.forged.clear()
            while not patient.forged:
                mallory.put(keys.beat("surgeon"), forged, attachment=its)
                time.sleep(0.02)
                assert time.monotonic() < until_s
            assert patient.heard() == []
        mallory.put(keys.beat("netem"), encode(Beat("netem", 5, 5, 7)))
        while not (found := patient.heard()):
            assert time.monotonic() < until_s
        assert [one.side for one in found] == ["netem"]
        surgeon.close()
        patient.close()
