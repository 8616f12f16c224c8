"""Pairs of captures that dpkt writes: pairing by payload, losses, a clock that is behind, damaged files."""

from pathlib import Path

import dpkt
import pytest

from tis.common.errors import DataError
from tis.deploy.net.fitting.captures import captured

MS = 1_000_000


def frame(payload: bytes, source: str = "\x0a\0\0\1", seq: int | None = None) -> bytes:
    sender = source.encode("latin-1")
    if seq is None:
        segment, protocol = dpkt.udp.UDP(sport=1000, dport=7447, data=payload), dpkt.ip.IP_PROTO_UDP
        segment.ulen = 8 + len(payload)
    else:
        segment, protocol = dpkt.tcp.TCP(sport=1000, dport=7447, seq=seq, data=payload), dpkt.ip.IP_PROTO_TCP
    packet = dpkt.ip.IP(src=sender, dst=b"\x0a\0\0\2", p=protocol, data=segment)
    packet.len = len(bytes(packet))
    return bytes(dpkt.ethernet.Ethernet(src=b"\1" * 6, dst=b"\2" * 6, type=dpkt.ethernet.ETH_TYPE_IP, data=packet))


def write(path: str, packets: list[tuple[float, bytes]]) -> Path:
    with Path(path).open("wb") as file:
        writer = dpkt.pcap.Writer(file)
        for at_s, content in packets:
            writer.writepkt(content, at_s)
    return Path(path)


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_packets_are_paired_by_payload_and_missing_ones_are_lost() -> None:
    sent = write("a.pcap", [(100 + k / 10, frame(b"message %d" % k)) for k in range(5)])
    there = [(100.012, frame(b"message 0", "\x0a\0\0\x63")), (100.31, frame(b"message 3")), (100.2, frame(b"other"))]
    there += [(100.45, frame(b"message 4"))]
    trace = captured(sent, write("b.pcap", sorted(there)))
    assert [round(delay / MS, 3) for delay in trace.delay_ns.tolist()] == [12, -0.0, -0.0, 10, 50]
    assert (trace.delay_ns < 0).tolist() == [False, True, True, False, False]
    assert [round(at / MS) for at in trace.sent_ns.tolist()] == [0, 100, 200, 300, 400]


def test_equal_payloads_are_paired_in_order_and_tcp_by_its_numbers() -> None:
    sent = write(
        "a.pcap", [(1.0, frame(b"x")), (2.0, frame(b"x")), (3.0, frame(b"x", seq=5)), (4.0, frame(b"x", seq=6))]
    )
    there = [(1.5, frame(b"x")), (2.25, frame(b"x")), (4.125, frame(b"x", seq=6))]
    trace = captured(sent, write("b.pcap", there))
    assert [round(delay / MS) for delay in trace.delay_ns.tolist()] == [500, 250, 0, 125]
    assert trace.delay_ns[2] < 0


def test_packets_outside_of_the_second_capture_do_not_count() -> None:
    sent = write("a.pcap", [(float(k), frame(b"message %d" % k)) for k in range(9)])
    trace = captured(sent, write("b.pcap", [(k + 0.5, frame(b"message %d" % k)) for k in (3, 4, 6)]))
    assert (trace.delay_ns < 0).tolist() == [False, False, True, False]


def test_a_clock_that_is_behind_is_shifted_and_named() -> None:
    sent = write("a.pcap", [(10.0 + k, frame(b"%d" % k)) for k in range(3)])
    trace = captured(sent, write("b.pcap", [(9.0 + k + k / 100, frame(b"%d" % k)) for k in range(3)]))
    assert [round(delay / MS) for delay in trace.delay_ns.tolist()] == [0, 10, 20]
    assert trace.about["clock"] == "the second clock is behind: shifted by 1000 ms"


def test_what_is_no_pair_of_captures_is_refused() -> None:
    good, other = write("a.pcap", [(1.0, frame(b"x"))]), write("b.pcap", [(1.0, frame(b"y"))])
    with pytest.raises(DataError, match="no payload is in both"):
        captured(good, other)
    Path("c.pcap").write_bytes(b"hello")
    with pytest.raises(DataError, match="must be a capture"):
        captured(good, Path("c.pcap"))
    with pytest.raises(DataError, match="must have UDP or TCP packets with a payload"):
        captured(write("d.pcap", []), good)
