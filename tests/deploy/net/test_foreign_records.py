"""Output of ping, JSON of irtt and CSV become records: texts by hand, numbers as they stand there."""

import json
from pathlib import Path

import dpkt
import pytest

from tis.common.errors import DataError
from tis.deploy.net.foreign_records import both_ways, captured, parse_round_trips

MS = 1_000_000
PING = """PING host.test (192.0.2.1) 56(84) bytes of data.
[1700000000.020000] 64 bytes from 192.0.2.1: icmp_seq=1 ttl=54 time=20.0 ms
[1700000001.030000] 64 bytes from host.test (192.0.2.1): icmp_seq=2 ttl=54 time=30 ms
[1700000003.025000] 64 bytes from host.test (192.0.2.1): icmp_seq=4 ttl=54 time=25.0 ms
[1700000003.026000] 64 bytes from host.test (192.0.2.1): icmp_seq=4 ttl=54 time=26.0 ms (DUP!)

--- host.test ping statistics ---
"""


def test_ping_with_stamps() -> None:
    trace = parse_round_trips(PING, "p.txt")
    assert trace is not None
    assert trace.delay_ns.tolist() == [20 * MS, 30 * MS, -1, 25 * MS]
    assert (trace.sent_ns / MS).tolist() == pytest.approx([0, 1000, 2000, 3000], abs=0.001)


def test_ping_without_stamps_assumes_one_a_second_and_says_so() -> None:
    plain = "\n".join(line.partition("] ")[2] or line for line in PING.splitlines())
    trace = parse_round_trips(plain, "p.txt")
    assert trace is not None
    assert trace.sent_ns.tolist() == [0, 1000 * MS, 2000 * MS, 3000 * MS]
    assert "assumed" in trace.about["sent"]


def test_the_numbers_of_ping_wrap() -> None:
    lines = [f"64 bytes from 192.0.2.1: icmp_seq={seq} ttl=5 time=1.0 ms" for seq in (65_534, 65_535, 1, 2)]
    trace = parse_round_trips("\n".join(lines), "p.txt")
    assert trace is not None
    assert trace.delay_ns.tolist() == [MS, MS, -1, MS, MS]


def test_irtt() -> None:
    def trip(seq: int, wall: int, rtt: int | None) -> dict[str, object]:
        delay = {} if rtt is None else {"rtt": rtt}
        lost = "true" if rtt is None else "false"
        return {"seqno": seq, "lost": lost, "timestamps": {"client": {"send": {"wall": wall}}}, "delay": delay}

    text = json.dumps({"round_trips": [trip(0, 10**18, 5 * MS), trip(1, 10**18 + 10 * MS, None)]})
    trace = parse_round_trips(text, "i.json")
    assert trace is not None
    assert trace.delay_ns.tolist() == [5 * MS, -1]
    assert trace.sent_ns.tolist() == [0, 10 * MS]


def test_csv_with_a_time_of_the_epoch() -> None:
    trace = parse_round_trips("time,rtt_ms\n1764000000.0,5\n1764000000.5,6\n", "r.csv")
    assert trace is not None
    assert trace.sent_ns.tolist() == [0, 500_000_000]


def test_csv_with_numbers_times_and_gaps() -> None:
    trace = parse_round_trips("# by hand\nseq,sent_s,rtt_ms\n7,100.0,5\n8,100.5,\n10,101.5,6.5\n", "r.csv")
    assert trace is not None
    assert trace.delay_ns.tolist() == [5 * MS, -1, -1, 6_500_000]
    assert trace.sent_ns.tolist() == [0, 500 * MS, 1000 * MS, 1500 * MS]


@pytest.mark.parametrize(
    "rows",
    [
        "time,rtt_ms\n2026-03-01T23:59:59.5Z,5\n2026-03-02T01:00:00+01:00,\n2026-03-02 00:00:00.500,6.5\n",
        "seq,timestamp,time\n1,2026-03-01T23:59:59.500,5\n2,2026-03-02 00:00:00,\n3,2026-03-02 00:00:00.500,6.5\n",
        'sent_at,rtt_ms\n"2026-03-01 23:59:59,500",5\n20260302T000000,\n2026-03-02T00:00:00.5,6.5\n',
    ],
)
def test_csv_with_times_in_iso_8601(rows: str) -> None:
    trace = parse_round_trips(rows, "r.csv")
    assert trace is not None
    assert trace.delay_ns.tolist() == [5 * MS, -1, 6_500_000]
    assert trace.sent_ns.tolist() == [0, 500 * MS, 1000 * MS]


def test_a_trace_of_our_own_is_none_of_them() -> None:
    assert parse_round_trips("sent_s,delay_ms\n0,1\n", "t.csv") is None
    assert parse_round_trips("", "t.csv") is None


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ('{"round_trips": 3}', "must be JSON of irtt"),
        ('{"round_trips": []}', "must have at least one answer"),
        (
            "seq,rtt_ms\n1,a\n",
            "row 1: seq must be a whole number; rtt_ms must be a number, empty",
        ),
        ("rtt_ms\n1\n", "must have a column seq"),
        (
            "time,latency\n0,0.1\n",
            r"must have a column of delays: delay_ms \(one way\), or of round trips: rtt_ms, time_ms",
        ),
        ("time,rtt_ms\n2026-02-30T00:00:00,1\n", "row 1: time must be a number or a time in ISO 8601"),
        ("seq,rtt_ms\n1,5\n999999999,5\n", "must not leave out more than a million numbers"),
        ("seq,rtt_ms\n1,timeout\n", "rtt_ms must be a number, empty where lost"),
    ],
)
def test_a_fault_is_one_rule(text: str, rule: str) -> None:
    with pytest.raises(DataError, match=rule):
        parse_round_trips(text, "x")


def test_both_ways_together_are_the_round_trip() -> None:
    trip = parse_round_trips("seq,rtt_ms\n1,20\n2,\n3,31\n", "r.csv")
    assert trip is not None
    varying, constant = both_ways(trip)
    assert constant.delay_ns.tolist() == [10 * MS] * 3
    assert varying.delay_ns.tolist() == [10 * MS, -1, 21 * MS]


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
