"""Records of round trips by other programs: the output of ping, JSON of irtt, CSV with a column of round trips.

A round trip does not tell its two ways apart. The constant part, the shortest round trip, is split in half; what
varies and what is lost is given to one way. So both ways together reproduce the round trips.
"""

import csv
import json
import re
from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from tis.common.errors import DataError, Fault
from tis.common.trace import LOST, MAX_DELAY_NS, Trace
from tis.common.units import NS_PER_MS, NS_PER_S

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
_HEAD: Final = re.compile(r"^(?!#)[^\n]*\S[^\n]*$", re.MULTILINE)
_MAX_GAP: Final = 1_000_000
_WRAP: Final = 65_536

Row = tuple[int, float | None, float | None]
"""Number of a request, when it was sent in ns, and its round trip in ns; None: unknown, or lost."""


def parse_round_trips(text: str, where: str) -> Trace | None:
    """Return the round trips of a text; None if it is none of the formats.

    Raises `DataError` with the first fault. Oracle: texts by hand, tests/deploy/net/fitting/test_round_trips.
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
    sent = next((name for name in _SENT if name in names and name != trip), None)
    if number is None and sent is None:
        rule = f"must have a column {', '.join(_NUMBERS)} or {', '.join(_SENT)} beside {trip}"
        raise DataError(Fault(where, "", rule))
    rows: list[Row] = []
    try:
        below = (line for line in text[found.end() :].splitlines() if line.strip() and not line.startswith("#"))
        for place, cells in enumerate(csv.reader(below)):
            row = dict(zip(names, (cell.strip() for cell in cells), strict=False))
            value = row.get(trip, "")
            rows.append(
                (
                    place if number is None else int(row[number]),
                    None if sent is None else _finite(row[sent]) * _SENT[sent],
                    _finite(value) * _ROUND_TRIPS[trip] if value else None,
                )
            )
    except (ValueError, KeyError, csv.Error, OverflowError):
        raise DataError(Fault(where, f"row {len(rows) + 1}", "must have numbers in its columns")) from None
    return rows


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
        about["sent"] = "send times are not recorded: one request a second is assumed"
    return Trace(where, sent_ns[order], delay_ns[order], about)
