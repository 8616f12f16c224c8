"""The ledger of a link: every decision and every departure, packet by packet, in batches for the log."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from operator import itemgetter
from typing import Any, Final

from tis.common.channels import Direction
from tis.common.node import Record
from tis.common.records import (
    COUNTERS,
    FATES,
    QUEUES,
    RELEASES,
    CounterNote,
    Departure,
    FateBatch,
    Outcome,
    QueueNote,
    ReleaseBatch,
)
from tis.common.scenario.network import Buffer
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.netem.link.packet import Fate, Packet

DROPS: Final = ("loss", "outage", "refused", "overflow", "queue_full", "late", "codel", "evicted")
"""The causes of drops."""

DROPPED_NEW: Final[Outcome] = "overflow"
"""The outcome of a message that finds no room."""

DROPPED_OLDEST: Final[Departure] = "evicted"
"""The departure of the message held longest, under the policy that drops it."""

_CLOSE_EVERY_NS: Final = 200 * NS_PER_MS
_QUEUE_EVERY_NS: Final = 10 * NS_PER_MS
_MAX_ROWS: Final = 4096

_Flow = tuple[str, bool]  # name, foreign: a plain tuple, which hashes faster than a named one
_FateRow = tuple[int, int, str, int, int, int, int, int, int]
_ReleaseRow = tuple[int, int, int, int, int, str, int, int]


class Ledger:
    """The records of one direction. Rows are plain tuples; the costly part runs in the thread that writes the log.

    The log has 0 for an instant that does not exist. Batches are closed on a grid of run time, so that two virtual
    runs write the same batches.
    """

    def __init__(self, direction: Direction) -> None:
        self._direction: Final = direction
        self._fates: list[tuple[str, Fate, int, int]] = []
        self._departures: list[tuple[Packet, int]] = []
        self._crossings: list[tuple[_Flow, int, int, int, int]] = []
        self._queue_notes: list[QueueNote] = []
        self._queue_noted_ns = -_QUEUE_EVERY_NS
        self._close_ns = _CLOSE_EVERY_NS

    def decided(self, name: str, fate: Fate, offered_ns: int, n_bytes: int) -> None:
        """Enter the fate of a packet."""
        self._fates.append((name, fate, offered_ns, n_bytes))

    def left(self, packet: Packet, released_ns: int) -> None:
        """Enter the departure of a packet; ``released_ns`` is ignored when it was dropped."""
        self._departures.append((packet, released_ns))

    def crossed(self, name: str, seq: int, foreign: bool, offered_ns: int, released_ns: int, n_bytes: int) -> None:
        """Enter fate and departure of a packet that was not held, at a third of the cost of `decided` and `left`."""
        self._crossings.append(((name, foreign), seq, offered_ns, released_ns, n_bytes))

    def queue_depth(self, now_ns: int, n_packets: int, n_bytes: int) -> None:
        """Enter the depth of the queues, at most a hundred times a second."""
        if now_ns - self._queue_noted_ns >= _QUEUE_EVERY_NS:
            self._queue_noted_ns = now_ns
            self._queue_notes.append(
                QueueNote(direction=self._direction, at_ns=now_ns, n_packets=n_packets, n_bytes=n_bytes)
            )

    def is_full(self, now_ns: int) -> bool:
        """Tell whether it is time to close the batches."""
        n_rows = len(self._fates) + len(self._departures) + 2 * len(self._crossings)
        return now_ns >= self._close_ns or n_rows >= _MAX_ROWS

    def close(self, now_ns: int) -> Callable[[], list[Record]]:
        """Close the batches; return a function that makes the records of all entries since the previous call.

        Closing costs next to nothing, for any number of keys; the returned function is for the thread that writes
        the log. It sorts crossed packets among the held ones (oracle: sorted, tests/netem/link/test_ledger).
        """
        fates, self._fates = self._fates, []
        departures, self._departures = self._departures, []
        crossings, self._crossings = self._crossings, []
        notes, self._queue_notes = self._queue_notes, []
        self._close_ns = (now_ns // _CLOSE_EVERY_NS + 1) * _CLOSE_EVERY_NS

        def make() -> list[Record]:
            # Stage 1: the rows of each flow.
            decided: defaultdict[_Flow, list[_FateRow]] = defaultdict(list)
            left: defaultdict[_Flow, list[_ReleaseRow]] = defaultdict(list)
            for name, fate, offered_ns, n_bytes in fates:
                decided[name, fate.foreign].append(_fate_row(fate, offered_ns, n_bytes))
            for packet, released_ns in departures:
                left[packet.flow.name, packet.foreign].append(_release_row(packet, released_ns))
            # Stage 2: crossed packets among the others, by instant.
            for flow, seq, offered_ns, released_ns, n_bytes in crossings:
                decided[flow].append((seq, offered_ns, "deliver", 0, offered_ns, n_bytes, 0, 0, 0))
                left[flow].append((seq, 0, offered_ns, offered_ns, released_ns, "released", 0, 0))
            for flow in {flow for flow, *_ in crossings}:
                decided[flow].sort(key=itemgetter(1))  # the instant of offering
                left[flow].sort(key=_gone_ns)
            # Stage 3: the records.
            records = [Record(FATES, now_ns, self._fate_batch(flow, rows)) for flow, rows in decided.items()]
            records += [Record(RELEASES, now_ns, self._release_batch(flow, rows)) for flow, rows in left.items()]
            return records + [Record(QUEUES, note.at_ns, note) for note in notes]

        return make

    def _fate_batch(self, flow: _Flow, rows: list[_FateRow]) -> FateBatch:
        seq, offered_ns, outcome, delay_ns, release_ns, n_bytes, copies, flipped, recovered = zip(*rows, strict=True)
        return FateBatch(
            direction=self._direction, key=flow[0], foreign=flow[1], seq=seq, offered_ns=offered_ns, outcome=outcome,
            delay_ns=delay_ns, release_ns=release_ns, n_bytes=n_bytes, copies=copies, flipped=flipped,
            recovered=_or_empty(recovered),
        )  # fmt: skip

    def _release_batch(self, flow: _Flow, rows: list[_ReleaseRow]) -> ReleaseBatch:
        seq, copy_index, offered_ns, release_ns, released_ns, departure, queued_ns, recovered_ns = zip(
            *rows, strict=True
        )
        return ReleaseBatch(
            direction=self._direction, key=flow[0], foreign=flow[1], seq=seq, copy_index=copy_index,
            offered_ns=offered_ns, release_ns=release_ns, released_ns=released_ns, departure=departure,
            queued_ns=queued_ns, recovered_ns=_or_empty(recovered_ns),
        )  # fmt: skip


class NoLedger(Ledger):
    """The ledger of a link that nobody looks into: it enters nothing."""

    def _ignore(self, *_: Any, **__: Any) -> None:
        pass

    decided = left = crossed = queue_depth = _ignore


def last_records(ledgers: Iterable[Ledger], counters: Mapping[str, int], now_ns: int) -> list[Record]:
    """Return the records that end an emulator's log: the open batches of its links and its counters."""
    records = [record for ledger in ledgers for record in ledger.close(now_ns)()]
    notes = (CounterNote(name=name, value=value) for name, value in counters.items())
    return records + [Record(COUNTERS, now_ns, note) for note in notes]


def _or_empty(column: tuple[int, ...]) -> tuple[int, ...]:
    return column if any(column) else ()


def _fate_row(fate: Fate, offered_ns: int, n_bytes: int) -> _FateRow:
    release_ns = fate.release_ns or 0
    return (
        fate.seq, offered_ns, fate.outcome, fate.delay_ns, release_ns, n_bytes, fate.n_copies, fate.n_flips,
        int(fate.recovered),
    )  # fmt: skip


def _release_row(packet: Packet, released_ns: int) -> _ReleaseRow:
    departure = packet.departure
    assert departure is not None, "it has not left"
    if departure != "released":
        released_ns = 0
    release_ns = packet.release_ns or 0
    return (
        packet.seq, packet.copy_index, packet.offered_ns, release_ns, released_ns, departure, packet.queued_ns,
        packet.recovered_ns,
    )  # fmt: skip


def _gone_ns(row: _ReleaseRow) -> int:
    """Return the instant at which a packet left, or was due to leave when it was dropped."""
    _, _, offered_ns, release_ns, released_ns, _, queued_ns, _ = row
    return released_ns or max(release_ns, offered_ns + queued_ns)


def full_buffer(buffer: Buffer, most_held: int | None) -> str:
    """Return the bound that was reached, as ``buffer of 20 MB full``.

    ``most_held`` is the largest number of messages held at a time; None if unknown, then both bounds are named.
    """
    packets, size = f"{buffer.max_packets} messages", f"{buffer.max_mb:g} MB"
    if most_held is None:
        return f"buffer of {size} or {packets} full"
    return f"buffer of {packets if most_held >= buffer.max_packets else size} full"


_START_NS: Final = 5 * NS_PER_S


def when_late(first_ns: int, last_ns: int, most_ns: int, newest_ns: int) -> str:
    """Return in a clause when messages left late, so that a stall at the start is not taken for a slow netem.

    Run times: of the first, the last and the worst late one, and of the newest message of all.
    """
    first_s, last_s, most_s = (ns / NS_PER_S for ns in (first_ns, last_ns, most_ns))
    if last_ns <= _START_NS and 2 * last_ns < newest_ns:
        return f"all late ones left in the first {last_s:.2f} s, the worst at {most_s:.2f} s: a stall at the start"
    return f"late ones left from {first_s:.2f} s to {last_s:.2f} s, the worst at {most_s:.2f} s"
