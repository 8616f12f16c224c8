"""Records by other programs: round trips of ping, irtt and CSV tables, and pairs of packet captures (extra ``pcap``).

A round trip does not tell its two ways apart. The constant part, the shortest round trip, is split in half; what
varies and what is lost is given to one way. So both ways together reproduce the round trips.
"""

import csv
import hashlib
import json
import re
from collections import defaultdict, deque
from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any, Final

import numpy as np

from tis.common.errors import DataError, Fault
from tis.common.extras import GET_PCAP
from tis.common.runtime.scenario_files import read_limited
from tis.common.trace import LOST, MAX_DELAY_NS, Trace
from tis.common.units import NS_PER_MS, NS_PER_S, NS_PER_US

_PING: Final = re.compile(
    r"^(?:\[(?P<at>\d{1,12}\.\d{1,9})\] )?\d{1,6} bytes from .{1,200}? ?icmp_seq=(?P<seq>\d{1,9}) .{0,40}?"
    r"time=(?P<ms>\d{1,9}(?:\.\d{1,6})?) ?ms",
    re.ASCII,
)
_NUMBERS: Final = ("seq", "seqno", "icmp_seq")
_ROUND_TRIPS: Final = {
    "rtt_ms": 1e6,
    "time_ms": 1e6,
    "rtt_us": 1e3,
    "rtt_ns": 1.0,
    "rtt_s": 1e9,
    "rtt": 1e6,
    "time": 1e6,
}
_SENT: Final = {"sent_s": 1e9, "time_s": 1e9, "timestamp": 1e9, "sent_ms": 1e6, "sent_ns": 1.0}
_DATES: Final = ("sent", "sent_at", "datetime", "date", "time")
"""Further columns of send times, in ISO 8601 only, but ``time`` also in s; those of `_SENT` may have it, too."""

_HEAD: Final = re.compile(r"^(?!#)[^\n]*\S[^\n]*$", re.MULTILINE)
_MAX_GAP: Final = 1_000_000
_WRAP: Final = 65_536
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)

Row = tuple[int, float | None, float | None]
"""Number of a request, when it was sent in ns, and its round trip in ns; None: unknown, or lost."""


def parse_round_trips(text: str, where: str) -> Trace | None:
    """Return the round trips of a text; None if it is none of the formats.

    Raises `DataError` with the first fault. Oracle: texts by hand, tests/deploy/net/test_foreign_records.
    """
    head = text.lstrip("\ufeff \t\r\n")
    if head.startswith("{"):
        rows, program = list(_irtt(head, where)), "irtt"
    elif _PING.search(head[:2000].partition("\n")[2]) or _PING.search(head[:2000]):
        rows, program = list(_ping(head)), "ping"
    else:
        found = _csv(head, where)
        if found is None:
            return None
        rows, program = found, "CSV"
    if not rows:
        raise DataError(Fault(where, "", f"must have at least one answer ({program})"))
    return _trace(rows, where, program)


def both_ways(trip: Trace) -> tuple[Trace, Trace]:
    """Return one way with all that varies and all losses, and one with the other half of the shortest round trip."""
    arrived = trip.delay_ns >= 0
    half_ns = int(trip.delay_ns[arrived].min()) // 2 if arrived.any() else 0
    about = {
        **trip.about,
        "split": f"the shortest round trip, {2 * half_ns / NS_PER_MS:.4g} ms, in halves; the rest and the losses are "
        "given to one way",
    }
    varying = np.where(arrived, trip.delay_ns - half_ns, LOST)
    constant = np.full(len(trip.sent_ns), half_ns, dtype=np.int64)
    return Trace(trip.label, trip.sent_ns, varying, about), Trace(trip.label, trip.sent_ns, constant, about)


def _ping(text: str) -> Iterator[Row]:
    """Yield the answers in output of ``ping``, with ``-D`` or without; numbers that are missing are lost."""
    beyond, latest = 0, -1
    for line in text.splitlines():
        found = _PING.match(line)
        if found is None or "DUP!" in line:
            continue
        number = int(found["seq"]) + beyond
        if number < latest - _WRAP // 2:  # ping counts in 16 bits
            beyond += _WRAP
            number += _WRAP
        latest = max(latest, number)
        trip_ns = float(found["ms"]) * NS_PER_MS
        # the stamp of -D is that of the answer
        yield number, None if found["at"] is None else float(found["at"]) * NS_PER_S - trip_ns, trip_ns


def _irtt(text: str, where: str) -> Iterator[Row]:
    """Yield the round trips in JSON of ``irtt client -o``."""
    try:
        trips = json.loads(text)["round_trips"]
        for trip in trips:
            sent_ns = trip["timestamps"]["client"]["send"]
            delay = trip.get("delay") or {}
            lost = str(trip["lost"]) not in ("false", "False")
            at_ns = sent_ns.get("wall", sent_ns.get("monotonic"))
            yield int(trip["seqno"]), float(at_ns), None if lost else float(delay["rtt"])
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError):
        rule = "must be JSON of irtt, with round_trips that have seqno, lost, timestamps.client.send and delay.rtt"
        raise DataError(Fault(where, "", rule)) from None


def _csv(text: str, where: str) -> list[Row] | None:
    """Return the rows of a CSV text with a column of round trips, None without one; lines with # are skipped."""
    found = _HEAD.search(text)  # alone at first: most files are traces of our own, and large
    if found is None:
        return None
    names = [name.strip().lower() for name in found[0].split(",")]
    trip = next((name for name in _ROUND_TRIPS if name in names), None)
    if trip is None:
        return None
    number = next((name for name in _NUMBERS if name in names), None)
    sent = next((name for name in (*_SENT, *_DATES) if name in names and name != trip), None)
    if number is None and sent is None:
        if trip == "time":  # rather that of sending, without a delay beside it
            trips = ", ".join(name for name in _ROUND_TRIPS if name != trip)
            rule = f"must have a column of delays: delay_ms (one way), or of round trips: {trips}"
            raise DataError(Fault(where, "", rule, found[0].strip()))
        rule = f"must have a column {', '.join(_NUMBERS)} or {', '.join((*_SENT, *_DATES))} beside {trip}"
        raise DataError(Fault(where, "", rule))
    rows: list[Row] = []
    row: dict[str, str] = {}
    try:
        below = (line for line in text[found.end() :].splitlines() if line.strip() and not line.startswith("#"))
        for place, cells in enumerate(csv.reader(below)):
            row = dict(zip(names, (cell.strip() for cell in cells), strict=False))
            value = row.get(trip, "")
            rows.append(
                (
                    place if number is None else int(row[number]),
                    None if sent is None else _instant_ns(row[sent], (_SENT | {"time": 1e9}).get(sent)),
                    _finite(value) * _ROUND_TRIPS[trip] if value else None,
                )
            )
    except (ValueError, KeyError, csv.Error, OverflowError):
        read = {number: "a whole number", sent: "a number or a time in ISO 8601", trip: "a number, empty where lost"}
        rule = "; ".join(f"{name} must be {what}" for name, what in read.items() if name is not None)
        got = ",".join(row.get(name, "") for name in read if name is not None)
        raise DataError(Fault(where, f"row {len(rows) + 1}", rule, got)) from None
    return rows


def _instant_ns(text: str, unit_ns: float | None) -> float:
    """Return an instant in ns from a number in a unit, or from a time in ISO 8601, without a zone of UTC."""
    with suppress(ValueError):
        if unit_ns is not None:
            return _finite(text) * unit_ns
    found = datetime.fromisoformat(text)
    since = (found if found.tzinfo else found.replace(tzinfo=UTC)) - _EPOCH
    return float((since.days * 86_400 + since.seconds) * NS_PER_S + since.microseconds * NS_PER_US)


def _finite(text: str) -> float:
    value = float(text)
    if not np.isfinite(value):
        raise ValueError(text)
    return value


def _trace(rows: list[Row], where: str, program: str) -> Trace:
    """Return the trace of requests, those without a row lost; without send times a request is 1 s after the last."""
    known: dict[int, Row] = {}
    for row in rows:
        if row[0] not in known or known[row[0]][2] is None:  # of two answers the first counts
            known[row[0]] = row
    numbers = np.array(sorted(known), dtype=np.int64)
    if int(numbers[-1] - numbers[0]) > _MAX_GAP + 2 * len(numbers):
        raise DataError(Fault(where, "", "must not leave out more than a million numbers", int(numbers[-1])))
    every = np.arange(numbers[0], numbers[-1] + 1)
    stamps: list[Any] = [known[int(number)][1] for number in numbers]
    timed = all(stamp is not None for stamp in stamps)
    at_ns = np.array(stamps, dtype=np.float64) if timed else (numbers - numbers[0]) * float(NS_PER_S)
    sent_ns = np.rint(np.interp(every, numbers, at_ns - at_ns.min())).astype(np.int64)
    delay_ns = np.full(len(every), LOST, dtype=np.int64)
    trips = [known[int(number)][2] for number in numbers]
    answered = np.array([trip is not None and 0 <= trip <= MAX_DELAY_NS for trip in trips])
    values = np.array([trip if ok else 0.0 for trip, ok in zip(trips, answered, strict=True)], dtype=np.float64)
    delay_ns[numbers[answered] - numbers[0]] = np.rint(values[answered]).astype(np.int64)
    order = np.argsort(sent_ns, kind="stable")
    about = {"delay": f"round trips, from {program}"}
    if not timed:
        about["sent"] = "send times are not recorded: one request a second is assumed, on which the half-life depends"
    return Trace(where, sent_ns[order], delay_ns[order], about)


SUFFIXES: Final = (".pcap", ".pcapng", ".cap")
_MAX_BYTES: Final = 2_000_000_000
_MAX_PACKETS: Final = 5_000_000

Seen = tuple[int, bytes]
"""When a packet was captured, in ns, and a digest of what does not change on its way."""


def captured(sent: Path, received: Path) -> Trace:
    """Return the record of the packets in ``sent`` as they appear in ``received``; raises `DataError`.

    Packets are paired by protocol and transport payload (of TCP also the sequence number), the first unpaired one
    first; addresses and ports may change on the way. Packets sent outside the time that the second capture covers do
    not count. Where the second clock is behind, its stamps are shifted until the shortest delay is 0.
    """
    there, here = _packets(sent), _packets(received)
    waiting: dict[bytes, deque[int]] = defaultdict(deque)
    for place, (_, digest) in enumerate(there):
        waiting[digest].append(place)
    sent_ns = np.array([at for at, _ in there], dtype=np.int64)
    delay_ns = np.full(len(there), LOST, dtype=np.int64)
    found = np.zeros(len(there), dtype=np.bool_)
    for at, digest in here:
        if waiting[digest]:
            place = waiting[digest].popleft()
            delay_ns[place], found[place] = at - sent_ns[place], True
    if not found.any():
        raise DataError(Fault(str(received), "", f"must have packets of {sent}: no payload is in both"))
    first, last = np.flatnonzero(found)[[0, -1]]
    sent_ns, delay_ns, found = sent_ns[first : last + 1], delay_ns[first : last + 1], found[first : last + 1]
    about = {"delay": f"captured in {received.name} after {sent.name}, by the clocks of the two captures"}
    behind_ns = int(delay_ns[found].min())
    if behind_ns < 0:
        delay_ns[found] -= behind_ns
        about["clock"] = f"the second clock is behind: shifted by {-behind_ns / NS_PER_MS:.6g} ms"
    if (worst := int(delay_ns[found].max())) > MAX_DELAY_NS:
        raise DataError(Fault(str(received), "", "must be by the clock of the first capture: an hour apart", worst))
    order = np.argsort(sent_ns, kind="stable")
    sent_ns = sent_ns[order] - sent_ns[order][0]
    return Trace(str(sent), sent_ns, delay_ns[order], about)


def _packets(path: Path) -> list[Seen]:
    if find_spec("dpkt") is None:
        raise DataError(Fault(str(path), "", f"needs the extra pcap: {GET_PCAP}")) from None
    try:
        content = read_limited(path, _MAX_BYTES)
    except OSError as error:
        raise DataError(Fault(str(path), "", f"cannot be read: {error.strerror}")) from None
    return parse_capture(content, str(path))


def parse_capture(content: bytes, where: str) -> list[Seen]:
    """Return the packets of a capture that carry a transport payload; raises `DataError` for another file."""
    import dpkt  # an extra

    try:
        found = list(_read(content, where, dpkt))
    except DataError:
        raise
    except Exception as error:  # dpkt documents no closed set of errors for a damaged file
        raise DataError(Fault(where, "", f"must be a capture (pcap or pcapng): {type(error).__name__}")) from None
    if not found:
        raise DataError(Fault(where, "", "must have UDP or TCP packets with a payload"))
    return found


def _read(content: bytes, where: str, dpkt: Any) -> Iterator[Seen]:
    reader = dpkt.pcap.UniversalReader(BytesIO(content))
    layers = {
        dpkt.pcap.DLT_EN10MB: dpkt.ethernet.Ethernet,
        dpkt.pcap.DLT_LINUX_SLL: dpkt.sll.SLL,
        dpkt.pcap.DLT_LINUX_SLL2: dpkt.sll2.SLL2,
        dpkt.pcap.DLT_NULL: dpkt.loopback.Loopback,
    }
    layer = layers.get(reader.datalink())
    if layer is None and reader.datalink() != dpkt.pcap.DLT_RAW:
        raise DataError(Fault(where, "", "must be of Ethernet, Linux cooked, loopback or raw IP", reader.datalink()))
    for number, (at_s, frame) in enumerate(reader):
        if number >= _MAX_PACKETS:
            raise DataError(Fault(where, "", f"must have at most {_MAX_PACKETS} packets"))
        digest = _digest(frame, layer, dpkt)
        if digest is not None:
            yield round(at_s * NS_PER_S), digest


def _digest(frame: bytes, layer: Any, dpkt: Any) -> bytes | None:
    """Return a digest of a packet's transport payload; None for one without, or cut short by the capture."""
    try:
        packet = (
            layer(frame).data if layer is not None else (dpkt.ip6.IP6 if frame[0] >> 4 == 6 else dpkt.ip.IP)(frame)
        )
        segment = getattr(packet, "data", None)
        if not isinstance(packet, dpkt.ip.IP | dpkt.ip6.IP6) or not isinstance(segment, dpkt.udp.UDP | dpkt.tcp.TCP):
            return None
        payload = bytes(segment.data)
    except (dpkt.UnpackError, IndexError, ValueError):
        return None
    if not payload:
        return None
    number = segment.seq.to_bytes(4, "big") if isinstance(segment, dpkt.tcp.TCP) else b""
    return hashlib.blake2b(number + payload, digest_size=16).digest()
