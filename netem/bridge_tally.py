"""What a bridge did, in a few lines: packets by direction, and how punctually they left."""

from collections.abc import Callable, Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.channels import Direction
from common.node import Record
from common.records import RELEASES, ReleaseBatch
from common.runtime.mcap_log import McapLog
from netem.synopsis import way

_PER_OCTAVE: Final = 32
_BINS: Final = 48 * _PER_OCTAVE
_COLUMNS: Final = ("offered", "released", "loss", "outage", "refused", "other", "held", "copies")
_OTHER: Final = ("overflow", "queue_full", "late", "codel", "evicted")


class ReleaseErrors:
    """How late packets left: a histogram with 32 bins an octave, so that a quantile is 2.2 % too high at most."""

    def __init__(self) -> None:
        self.n = 0
        self.most_ns = 0
        self._counts: NDArray[np.int64] = np.zeros(_BINS, dtype=np.int64)

    def add(self, errors_ns: NDArray[np.int64]) -> None:
        """Enter release errors, in ns, (N,)."""
        if len(errors_ns) == 0:
            return
        bins = np.floor(_PER_OCTAVE * np.log2(np.maximum(errors_ns, 1))).astype(np.int64)
        self._counts += np.bincount(np.minimum(bins, _BINS - 1), minlength=_BINS)
        self.n += len(errors_ns)
        self.most_ns = max(self.most_ns, int(errors_ns.max()))

    def quantile_ns(self, p: float) -> float:
        """Return the least upper edge of a bin at or below which share ``p`` lies; 0 without packets.

        Oracle: sorting (tests/netem/test_bridge_tally).
        """
        if self.n == 0:
            return 0.0
        at = int(np.searchsorted(np.cumsum(self._counts), np.ceil(p * self.n)))
        return min(float(self.most_ns), float(2.0 ** ((at + 1) / _PER_OCTAVE)))


class Tally:
    """Stands before the log, or in its place: counts what is written, in the writer's thread."""

    def __init__(self, log: McapLog | None) -> None:
        self.errors: Final[dict[Direction, ReleaseErrors]] = {"forward": ReleaseErrors(), "feedback": ReleaseErrors()}
        self._log = log

    def record(self, record: Record) -> None:
        """Count releases and hand the record on."""
        if record.topic == RELEASES:
            assert isinstance(record.data, ReleaseBatch)
            self._count(record.data)
        if self._log is not None:
            self._log.record(record)

    def attach(self, name: str, data: bytes) -> None:
        """Add a file to the log."""
        if self._log is not None:
            self._log.attach(name, data)

    def flush(self) -> None:
        """Flush the log."""
        if self._log is not None:
            self._log.flush()

    def close(self) -> None:
        """Close the log."""
        if self._log is not None:
            self._log.close()

    def _count(self, batch: ReleaseBatch) -> None:
        released_ns = np.array(batch.released_ns, dtype=np.int64)
        errors_ns = released_ns - np.array(batch.release_ns, dtype=np.int64)
        self.errors[batch.direction].add(errors_ns[released_ns > 0])


def table(counters: Mapping[str, int], errors: Mapping[Direction, ReleaseErrors]) -> list[str]:
    """Return the lines that are printed at the end."""
    head = ["", *_COLUMNS, "late us: p50", "p99", "max"]
    rows = [head, *(_row(direction, counters, errors[direction]) for direction in errors)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(head))]
    lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows]
    return [*lines, *_more(counters)]


def _row(direction: Direction, counters: Mapping[str, int], errors: ReleaseErrors) -> list[str]:
    def count(name: str) -> int:
        return counters[f"{direction}.{name}"]

    dropped = [count(f"dropped.{cause}") for cause in ("loss", "outage", "refused")]
    other = sum(count(f"dropped.{cause}") for cause in _OTHER)
    numbers = [count("offered"), count("released"), *dropped, other, count("held_at_end"), count("copied")]
    late_ns = [errors.quantile_ns(0.5), errors.quantile_ns(0.99), float(errors.most_ns)]
    return [way(direction), *map(str, numbers), *(f"{ns * 1e-3:.0f}" for ns in late_ns)]


def _more(counters: Mapping[str, int]) -> list[str]:
    parts: Sequence[tuple[str, Callable[[int], str]]] = (
        ("queries.asked", lambda n: f"{n} queries with {counters['queries.replies']} replies"),
        ("queries.timed_out", lambda n: f"{n} queries timed out"),
        ("tokens.changes", lambda n: f"{n} changes of liveliness tokens"),
        ("tokens.cuts", lambda n: f"{n} times all tokens withdrawn by an outage"),
        ("before_epoch", lambda n: f"{n} messages before the beginning"),
        ("unsent", lambda n: f"{n} messages that Zenoh refused to send"),
        ("queries.unsent", lambda n: f"{n} replies after the end of their query"),
        ("leaks", lambda n: f"{n} ways past netem found: not valid"),
    )
    words = [say(counters[name]) for name, say in parts if counters.get(name)]
    return [", ".join(words)] if words else []
