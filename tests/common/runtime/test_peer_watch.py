"""Rows of the kernel's table of connections; live, a network that is taken down: tests/system/test_peers."""

import socket

import pytest

from tis.common.runtime import peer_watch


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
