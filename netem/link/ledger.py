"""What a link decided and did, packet by packet, gathered into batches for the log."""

from collections.abc import Callable
from typing import Final, NamedTuple

from common.channels import Direction
from common.node import Record
from common.records import FATES, QUEUES, RELEASES, FateBatch, QueueNote, ReleaseBatch
from common.units import NS_PER_MS
from netem.link.packet import Due, Fate

_CLOSE_EVERY_NS: Final = 200 * NS_PER_MS
_QUEUE_EVERY_NS: Final = 10 * NS_PER_MS
_MOST_ROWS: Final = 4096

_FateRow = tuple[int, int, str, int, int, int, int, int]
_ReleaseRow = tuple[int, int, int, int, int, str, int]
_CrossingRow = tuple[int, int, int, int]


def _offered_ns(row: _FateRow) -> int:
    return row[1]


def _gone_ns(row: _ReleaseRow) -> int:
    """Return when a packet left, or, where it did not, when it was to."""
    _, _, offered_ns, release_ns, released_ns, _, queued_ns = row
    return released_ns or max(release_ns, offered_ns + queued_ns)


class _Flow(NamedTuple):
    name: str
    foreign: bool


class Ledger:
    """The books of one direction. Rows are tuples; what is costly is done where a record is written.

    Batches are closed on a grid of run time, so that two virtual runs write the same ones.
    """

    def __init__(self, direction: Direction) -> None:
        self.direction: Final = direction
        self._fates: dict[_Flow, list[_FateRow]] = {}
        self._releases: dict[_Flow, list[_ReleaseRow]] = {}
        self._crossings: dict[tuple[str, bool], list[_CrossingRow]] = {}
        self._queue_notes: list[QueueNote] = []
        self._queue_noted_ns = -_QUEUE_EVERY_NS
        self._close_ns = _CLOSE_EVERY_NS
        self._n_rows = 0

    def decided(self, name: str, fate: Fate, offered_ns: int, n_bytes: int) -> None:
        """Enter what was decided for a packet."""
        flow = _Flow(name, fate.foreign)
        rows = self._fates.get(flow)
        if rows is None:
            rows = self._fates[flow] = []
        rows.append(
            (fate.seq, offered_ns, fate.outcome, fate.delay_ns, fate.release_ns, n_bytes, fate.n_copies, fate.n_flips)
        )
        self._n_rows += 1

    def left(self, due: Due, released_ns: int) -> None:
        """Enter how a packet left; ``released_ns`` counts only for those that really did."""
        flow = _Flow(due.name, due.foreign)
        rows = self._releases.get(flow)
        if rows is None:
            rows = self._releases[flow] = []
        if due.departure != "released":
            released_ns = 0
        rows.append(
            (due.seq, due.copy_index, due.offered_ns, due.release_ns, released_ns, due.departure, due.queued_ns)
        )
        self._n_rows += 1

    def crossed(self, name: str, seq: int, foreign: bool, offered_ns: int, released_ns: int, n_bytes: int) -> None:
        """Enter a packet that left as it came: the same as `decided` and `left`, at a third of the cost."""
        flow = (name, foreign)
        rows = self._crossings.get(flow)
        if rows is None:
            rows = self._crossings[flow] = []
        rows.append((seq, offered_ns, released_ns, n_bytes))
        self._n_rows += 2

    def queue_depth(self, now_ns: int, n_packets: int, n_bytes: int) -> None:
        """Enter a queue's depth, at most a hundred times a second."""
        if now_ns - self._queue_noted_ns >= _QUEUE_EVERY_NS:
            self._queue_noted_ns = now_ns
            self._queue_notes.append(
                QueueNote(direction=self.direction, at_ns=now_ns, n_packets=n_packets, n_bytes=n_bytes)
            )

    def is_full(self, now_ns: int) -> bool:
        """Tell whether it is time to close the batches."""
        return now_ns >= self._close_ns or self._n_rows >= _MOST_ROWS

    def close(self, now_ns: int) -> Callable[[], list[Record]]:
        """Close the batches; return what makes records of what was entered since the last time.

        Closing costs next to nothing, whatever the number of keys: the rest is for the thread that writes. What
        crossed at once stands where it belongs among what was held (oracle: sorted, tests/netem/link/test_ledger).
        """
        fates, self._fates = self._fates, {}
        releases, self._releases = self._releases, {}
        crossings, self._crossings = self._crossings, {}
        notes, self._queue_notes = self._queue_notes, []
        self._close_ns = (now_ns // _CLOSE_EVERY_NS + 1) * _CLOSE_EVERY_NS
        self._n_rows = 0

        def make() -> list[Record]:
            for (name, foreign), rows in crossings.items():
                flow = _Flow(name, foreign)
                fates.setdefault(flow, []).extend(
                    (seq, offered_ns, "deliver", 0, offered_ns, n_bytes, 0, 0) for seq, offered_ns, _, n_bytes in rows
                )
                releases.setdefault(flow, []).extend(
                    (seq, 0, offered_ns, offered_ns, released_ns, "released", 0)
                    for seq, offered_ns, released_ns, _ in rows
                )
                fates[flow].sort(key=_offered_ns)
                releases[flow].sort(key=_gone_ns)
            records = [Record(FATES, now_ns, self._fate_batch(flow, rows)) for flow, rows in fates.items()]
            records += [Record(RELEASES, now_ns, self._release_batch(flow, rows)) for flow, rows in releases.items()]
            return records + [Record(QUEUES, note.at_ns, note) for note in notes]

        return make

    def _fate_batch(self, flow: _Flow, rows: list[_FateRow]) -> FateBatch:
        seq, offered_ns, outcome, delay_ns, release_ns, n_bytes, copies, flipped = zip(*rows, strict=True)
        return FateBatch.model_construct(
            direction=self.direction, key=flow.name, foreign=flow.foreign, seq=seq, offered_ns=offered_ns,
            outcome=outcome, delay_ns=delay_ns, release_ns=release_ns, n_bytes=n_bytes, copies=copies,
            flipped=flipped,
        )  # fmt: skip

    def _release_batch(self, flow: _Flow, rows: list[_ReleaseRow]) -> ReleaseBatch:
        seq, copy_index, offered_ns, release_ns, released_ns, departure, queued_ns = zip(*rows, strict=True)
        return ReleaseBatch.model_construct(
            direction=self.direction, key=flow.name, foreign=flow.foreign, seq=seq, copy_index=copy_index,
            offered_ns=offered_ns, release_ns=release_ns, released_ns=released_ns, departure=departure,
            queued_ns=queued_ns,
        )  # fmt: skip
