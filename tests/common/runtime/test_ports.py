"""Ports that stay free until the process for which they are listens there."""

import socket
from pathlib import Path

import pytest

from tis.common.runtime import ports
from tis.common.runtime.ports import free_endpoints, free_ports

KINDS = [socket.SOCK_STREAM, socket.SOCK_DGRAM]


@pytest.mark.parametrize("kind", KINDS)
def test_no_outgoing_connection_is_given_one(kind: socket.SocketKind) -> None:
    """The kernel's own setting is the oracle; a port that ``bind`` names free lies in its range."""
    first, last = map(int, Path("/proc/sys/net/ipv4/ip_local_port_range").read_text().split())
    found = free_ports(200, kind)
    assert len(set(found)) == 200
    assert not [port for port in found if first <= port <= last]


@pytest.mark.parametrize("kind", KINDS)
def test_one_in_use_is_passed_over(kind: socket.SocketKind, monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket(socket.AF_INET, kind) as taken:
        taken.bind(("127.0.0.1", 0))
        mine = taken.getsockname()[1]
        free, other = free_ports(2, kind)
        offered = iter([mine, free, mine, free, other])
        monkeypatch.setattr(ports, "_not_handed_out", lambda: next(offered))
        assert free_ports(2, kind) == [free, other]


def test_where_the_kernel_hands_out_all_it_finds_the_port(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    setting = tmp_path / "range"
    setting.write_text("1024\t65535\n")
    monkeypatch.setattr(ports, "_HANDED_OUT", setting)
    assert all(port > 0 for port in free_ports(3))
    setting.unlink()
    assert all(10_000 <= port < 32_768 for port in free_ports(3))


def test_endpoints_are_two_of_loopback() -> None:
    west, east = free_endpoints("tls")
    assert west != east
    assert [one.rpartition(":")[0] for one in (west, east)] == ["tls/127.0.0.1"] * 2
