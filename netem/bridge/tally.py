"""The watch over a bridge's log: release errors and full buffers while it is written, and the summary at the end.

Drops by a full buffer are not part of the configured network, so the user is warned at once.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import DESTINATION, Direction
from tis.common.node import Record
from tis.common.records import RELEASES, ReleaseBatch
from tis.common.runtime.recorder import FileLog
from tis.common.scenario.network import Buffer
from tis.netem.expected.figures import direction_label
from tis.netem.link.ledger import DROPPED_NEW, DROPPED_OLDEST, DROPS, full_buffer
from tis.netem.link.link import Link

_PER_OCTAVE: Final = 32
_BINS: Final = 48 * _PER_OCTAVE


class ReleaseErrors:
    """Release errors as a histogram with 32 bins per octave: a quantile is at most 2.2 % too high."""

    def __init__(self) -> None:
        self.n = 0
        self.most_ns = 0
        self._counts: NDArray[np.int64] = np.zeros(_BINS, dtype=np.int64)

    def add(self, errors_ns: NDArray[np.int64]) -> None:
        """Add release errors, in ns, (N,)."""
        if len(errors_ns) == 0:
            return
        bins = np.floor(_PER_OCTAVE * np.log2(np.maximum(errors_ns, 1))).astype(np.int64)
        self._counts += np.bincount(np.minimum(bins, _BINS - 1), minlength=_BINS)
        self.n += len(errors_ns)
        self.most_ns = max(self.most_ns, int(errors_ns.max()))

    def add_all(self, other: "ReleaseErrors") -> None:
        """Add the errors of another histogram."""
        self._counts += other._counts
        self.n += other.n
        self.most_ns = max(self.most_ns, other.most_ns)

    def quantile_ns(self, p: float) -> float:
        """Return the smallest upper edge of a bin that covers share ``p``; 0 without packets.

        Oracle: sorting (tests/netem/bridge/test_tally).
        """
        if self.n == 0:
            return 0.0
        at = int(np.searchsorted(np.cumsum(self._counts), np.ceil(p * self.n)))
        return min(float(self.most_ns), float(2.0 ** ((at + 1) / _PER_OCTAVE)))


class WatchedLog:
    """A wrapper of a log, or a substitute without one.

    It calls ``look`` at each flush, twice a second, and at the end, in the thread that writes.
    """

    def __init__(self, log: FileLog | None, look: Callable[[], None]) -> None:
        self.n_records = 0
        self._log = log
        self._look = look

    def record(self, record: Record) -> None:
        """Pass a record on."""
        self.n_records += 1
        if self._log is not None:
            self._log.record(record)

    def attach(self, name: str, data: bytes) -> None:
        """Add a file to the log."""
        if self._log is not None:
            self._log.attach(name, data)

    def flush(self) -> None:
        """Call ``look`` and flush the log."""
        self._look()
        if self._log is not None:
            self._log.flush()

    def close(self) -> None:
        """Call ``look`` for the last time and close the log."""
        self._look()
        if self._log is not None:
            self._log.close()


class BufferWatch:
    """A warning for each direction, once, after a full buffer has dropped messages; any thread may call `look`."""

    def __init__(self, links: Mapping[Direction, Link], buffer: Buffer, warn: Callable[[str], None]) -> None:
        self._left: dict[Direction, Link] = dict(links)
        self._buffer = buffer
        self._warn = warn

    def look(self) -> None:
        """Warn of the directions in which the first drop has occurred."""
        for direction, link in list(self._left.items()):
            if link.dropped[DROPPED_NEW] or link.dropped[DROPPED_OLDEST]:
                del self._left[direction]
                full = full_buffer(self._buffer, link.most_held)
                rule = "it drops messages, which is not part of the configured network"
                self._warn(f"{direction_label(direction)}: {full}: {rule}")


class Tally(WatchedLog):
    """A log that also collects release errors."""

    def __init__(self, log: FileLog | None, look: Callable[[], None]) -> None:
        super().__init__(log, look)
        self.errors: Final[dict[Direction, ReleaseErrors]] = {"forward": ReleaseErrors(), "feedback": ReleaseErrors()}

    def record(self, record: Record) -> None:
        """Count releases and pass the record on."""
        if record.topic == RELEASES:
            assert isinstance(record.data, ReleaseBatch)
            self._count(record.data)
        super().record(record)

    def _count(self, batch: ReleaseBatch) -> None:
        released_ns = np.array(batch.released_ns, dtype=np.int64)
        errors_ns = released_ns - np.array(batch.release_ns, dtype=np.int64)
        self.errors[batch.direction].add(errors_ns[released_ns > 0])


def table(counters: Mapping[str, int], errors: Mapping[Direction, ReleaseErrors]) -> list[str]:
    """Return the lines printed at the end; a cause without drops has no column."""
    causes = [cause for cause in DROPS if any(counters[f"{direction}.dropped.{cause}"] for direction in errors)]
    columns = ("offered", "released", *(f"dropped.{cause}" for cause in causes), "held_at_end", "copied")
    head = ["", "offered", "released", *causes, "held", "copies", "late us: p50", "p99", "max"]
    rows = [head, *(_row(direction, columns, counters, errors[direction]) for direction in errors)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(head))]
    lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows]
    return [*lines, *_more(counters)]


def _row(
    direction: Direction, columns: Sequence[str], counters: Mapping[str, int], errors: ReleaseErrors
) -> list[str]:
    numbers = (counters[f"{direction}.{name}"] for name in columns)
    late_ns = [errors.quantile_ns(0.5), errors.quantile_ns(0.99), float(errors.most_ns)]
    return [direction_label(direction), *map(str, numbers), *(f"{ns * 1e-3:.0f}" for ns in late_ns)]


def _more(counters: Mapping[str, int]) -> list[str]:
    parts: Sequence[tuple[str, Callable[[int], str]]] = (
        ("queries.asked", lambda n: f"{n} queries with {counters['queries.replies']} replies"),
        ("queries.timed_out", lambda n: f"{n} queries timed out"),
        ("tokens.changes", lambda n: f"{n} changes of liveliness tokens"),
        ("tokens.cuts", lambda n: f"{n} times all tokens withdrawn by an outage"),
        ("before_epoch", lambda n: f"{n} messages before the beginning"),
        ("unsent", lambda n: f"{n} messages that Zenoh refused to send"),
        ("queries.unsent", lambda n: f"{n} replies after the end of their query"),
        ("leaks", lambda n: f"{n} way{'s' if n > 1 else ''} past netem found: not valid"),
    )
    words = [text(counters[name]) for name, text in parts if counters.get(name)]
    causes = (DROPPED_NEW, DROPPED_OLDEST)
    if n_full := sum(counters[f"{direction}.dropped.{cause}"] for direction in DESTINATION for cause in causes):
        words.append(f"{n_full} messages dropped by a full buffer: not part of the configured network")
    n_held, n_overdue = (
        sum(counters.get(f"{direction}.{name}", 0) for direction in DESTINATION)
        for name in ("held_back", "held_back_overdue")
    )
    words += [f"{n_held} messages held back at a full queue"] if n_held else []
    words += [f"{n_overdue} let go on before there was room"] if n_overdue else []
    return [", ".join(words)] if words else []
