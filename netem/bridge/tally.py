"""Figures of a bridge while its log is written: release errors, realised delays, and the table at the end."""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import DESTINATION, Direction
from tis.common.node import Record
from tis.common.records import FateBatch, ReleaseBatch
from tis.common.runtime.recorder import FileLog
from tis.common.scenario.control import RecentDelays
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.netem.bridge.audit import AuditTrail
from tis.netem.bridge.watches import LATE_NS, LateWatch, RulesWatch, names_near_bounds
from tis.netem.control.replay import ways_past
from tis.netem.expected.synopsis import direction_label
from tis.netem.link.ledger import DROPPED_NEW, DROPPED_OLDEST, DROPS, when_late
from tis.netem.link.packet import flow_key

_PER_OCTAVE: Final = 32
_BINS: Final = 48 * _PER_OCTAVE
RECENT_S: Final = 5.0


class ReleaseErrors:
    """Release errors as a histogram with 32 bins per octave: a quantile is at most 2.2 % too high."""

    def __init__(self) -> None:
        self.n = 0
        self.n_late = 0
        """Errors above `LATE_NS`."""
        self.most_ns = 0
        self.most_at_ns = 0
        """When the one with the largest error left."""
        self.late_at_ns: tuple[int, int] | None = None
        """When the first and the last one above `LATE_NS` left."""
        self.newest_ns = 0
        self._counts: NDArray[np.int64] = np.zeros(_BINS, dtype=np.int64)

    def add(self, errors_ns: NDArray[np.int64], left_ns: NDArray[np.int64]) -> None:
        """Add release errors, and when each message left, in ns, (N,)."""
        if len(errors_ns) == 0:
            return
        bins = np.floor(_PER_OCTAVE * np.log2(np.maximum(errors_ns, 1))).astype(np.int64)
        self._counts += np.bincount(np.minimum(bins, _BINS - 1), minlength=_BINS)
        self.n += len(errors_ns)
        late_ns = left_ns[errors_ns > LATE_NS]
        if len(late_ns):
            self.n_late += len(late_ns)
            first_ns, last_ns = int(late_ns.min()), int(late_ns.max())
            before = self.late_at_ns or (first_ns, last_ns)
            self.late_at_ns = min(before[0], first_ns), max(before[1], last_ns)
        if errors_ns.max() > self.most_ns:
            self.most_ns, self.most_at_ns = int(errors_ns.max()), int(left_ns[errors_ns.argmax()])
        self.newest_ns = max(self.newest_ns, int(left_ns.max()))

    def add_all(self, other: "ReleaseErrors") -> None:
        """Add the errors of another histogram."""
        self._counts += other._counts
        self.n += other.n
        self.n_late += other.n_late
        spans = [one for one in (self.late_at_ns, other.late_at_ns) if one is not None]
        self.late_at_ns = (min(one[0] for one in spans), max(one[1] for one in spans)) if spans else None
        if other.most_ns > self.most_ns:
            self.most_ns, self.most_at_ns = other.most_ns, other.most_at_ns
        self.newest_ns = max(self.newest_ns, other.newest_ns)

    def quantile_ns(self, p: float) -> float:
        """Return the smallest upper edge of a bin that covers share ``p``; 0 without packets.

        Oracle: sorting (tests/netem/bridge/test_tally).
        """
        if self.n == 0:
            return 0.0
        at = int(np.searchsorted(np.cumsum(self._counts), np.ceil(p * self.n)))
        return min(float(self.most_ns), float(2.0 ** ((at + 1) / _PER_OCTAVE)))


class Realised:
    """What became of one direction's messages, copies aside: delays, and how many were sent again by a recovery."""

    def __init__(self) -> None:
        self.n = 0
        self.n_again = 0
        self._sum_ms = 0.0
        self._squares = 0.0
        # newest instant of leaving and all of them, in ns, and delays in ms
        self._recent: deque[tuple[int, NDArray[np.int64], NDArray[np.float64]]] = deque()

    def add(self, left_ns: NDArray[np.int64], delays_ns: NDArray[np.int64]) -> None:
        """Add messages that left: their instants and delays, in ns, (N,)."""
        if len(left_ns) == 0:
            return
        delays_ms = delays_ns / NS_PER_MS
        newest_ns = int(left_ns.max())
        self._recent.append((newest_ns, left_ns, delays_ms))
        while self._recent[0][0] <= newest_ns - int(RECENT_S * NS_PER_S):
            self._recent.popleft()
        self.n += len(delays_ms)
        self._sum_ms += float(delays_ms.sum())
        self._squares += float(delays_ms @ delays_ms)

    def recent(self, now_ns: int) -> RecentDelays | None:
        """Return the delays of what left in the `RECENT_S` before ``now_ns``; None where nothing did."""
        since_ns = now_ns - int(RECENT_S * NS_PER_S)
        recent = tuple(self._recent)  # in one step, as another thread adds to it
        parts = [delays_ms[left_ns > since_ns] for newest_ns, left_ns, delays_ms in recent if newest_ns > since_ns]
        delays_ms = np.concatenate(parts) if parts else np.empty(0)
        if not len(delays_ms):
            return None
        p50_ms, p99_ms = (float(value) for value in np.quantile(delays_ms, (0.5, 0.99)))
        return RecentDelays(within_s=RECENT_S, n=len(delays_ms), p50_ms=p50_ms, p99_ms=p99_ms)

    def __str__(self) -> str:
        """Return mean and standard deviation in the words of `tis.netem.expected.synopsis`."""
        if not self.n:
            return "nothing left"
        mean_ms = self._sum_ms / self.n
        std_ms = max(0.0, self._squares / self.n - mean_ms**2) ** 0.5
        again = f", {self.n_again} sent again (recovery)" if self.n_again else ""
        return f"delay {mean_ms:.4g} ms, sd {std_ms:.3g}{again}"


class WatchedLog:
    """A wrapper of a log, or a substitute without one.

    It calls all ``looks`` at each flush, twice a second, and at the end, in the thread that writes. It notes how long
    the audit log is, if there is one, and ends that before itself.
    """

    def __init__(self, log: FileLog | None, *looks: Callable[[], None], audit: AuditTrail | None = None) -> None:
        self.n_records = 0
        self._audit = audit
        self._log = log
        self._looks = looks

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
        """Call the looks and flush the log."""
        self._look()
        if self._log is not None:
            for record in () if self._audit is None else self._audit.look():
                self._log.record(record)
            self._log.flush()

    def close(self) -> None:
        """Call the looks for the last time and close the log."""
        self._look()
        if self._log is not None:
            for record in () if self._audit is None else self._audit.finish():
                self._log.record(record)
            self._log.close()

    def _look(self) -> None:
        for look in self._looks:
            look()


class Tally(WatchedLog):
    """A log that also collects release errors, and warns of what is not part of the configured network."""

    def __init__(
        self, log: FileLog | None, warn: Callable[[str], None], *looks: Callable[[], None],
        audit: AuditTrail | None = None, rules: RulesWatch | None = None,
    ) -> None:  # fmt: skip
        self._late: Final = LateWatch(warn)
        self.rules: Final = rules or RulesWatch({})
        super().__init__(log, self._late.look, *looks, audit=audit)
        self.errors: Final[dict[Direction, ReleaseErrors]] = {"forward": ReleaseErrors(), "feedback": ReleaseErrors()}
        self.realised: Final[dict[Direction, Realised]] = {"forward": Realised(), "feedback": Realised()}

    def record(self, record: Record) -> None:
        """Count releases and repeats, and pass the record on."""
        if isinstance(record.data, ReleaseBatch):
            self._count(record.data)
        elif isinstance(record.data, FateBatch):
            self.realised[record.data.direction].n_again += sum(record.data.recovered)
            self.rules.match(record.data.direction, flow_key(record.data.key))
        super().record(record)

    def recent(self, now_ns: int) -> dict[Direction, RecentDelays | None]:
        """Return by direction the delays of what left lately."""
        return {direction: found.recent(now_ns) for direction, found in self.realised.items()}

    def _count(self, batch: ReleaseBatch) -> None:
        released_ns = np.array(batch.released_ns, dtype=np.int64)
        errors_ns = released_ns - np.array(batch.release_ns, dtype=np.int64)
        left = released_ns > 0
        delays_ns = released_ns - np.array(batch.offered_ns, dtype=np.int64)
        originals = left & (np.array(batch.copy_index) == 0)
        self.realised[batch.direction].add(released_ns[originals], delays_ns[originals])
        errors_ns = errors_ns[left]
        self.errors[batch.direction].add(errors_ns, released_ns[left])
        if len(errors_ns):
            worst = int(errors_ns.argmax())
            self._late.count(batch.direction, int(errors_ns[worst]), int(released_ns[left][worst]))


def table(counters: Mapping[str, int], tally: Tally, requested: Sequence[str]) -> list[str]:
    """Return the lines printed at the end; a cause without drops has no column.

    ``requested`` is the `tis.netem.expected.synopsis`, which lacks the changes during the run.
    """
    errors = tally.errors
    causes = [cause for cause in DROPS if any(counters[f"{direction}.dropped.{cause}"] for direction in errors)]
    columns = ("offered", "released", *(f"dropped.{cause}" for cause in causes), "held_at_end", "copied")
    head = ["", "offered", "released", *causes, "held", "copies", "released late, us: p50", "p99", "max"]
    rows = [head, *(_row(direction, columns, counters, errors[direction]) for direction in errors)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(head))]
    lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows]
    changed = ", with changes" if counters.get("control.accepted") else ""
    lines += [
        f"{asked}; realised{changed}: {found}"
        for asked, found in zip(requested, tally.realised.values(), strict=True)
    ]
    late = [text for direction, found in errors.items() for text in _late_text(direction, found)]
    near = [
        f"{direction_label(direction)}: {text}"
        for direction in errors
        for text in names_near_bounds(counters, f"{direction}.")
    ]
    return [*lines, *_more(counters), *late, *near]


def _late_text(direction: Direction, errors: ReleaseErrors) -> list[str]:
    if errors.late_at_ns is None:
        return []
    label, bound_ms = direction_label(direction), LATE_NS // NS_PER_MS
    return [  # a writer that is behind drops records
        f"{label}: at least {errors.n_late} messages left more than {bound_ms} ms after their instants: "
        f"not part of the configured network; {when_late(*errors.late_at_ns, errors.most_at_ns, errors.newest_ns)}"
    ]


def _row(
    direction: Direction, columns: Sequence[str], counters: Mapping[str, int], errors: ReleaseErrors
) -> list[str]:
    numbers = (counters[f"{direction}.{name}"] for name in columns)
    late_ns = [errors.quantile_ns(0.5), errors.quantile_ns(0.99), float(errors.most_ns)]
    return [direction_label(direction), *map(str, numbers), *(f"{ns * 1e-3:.0f}" for ns in late_ns)]


def _more(counters: Mapping[str, int]) -> list[str]:
    parts: Sequence[tuple[str, Callable[[int], str]]] = (
        ("queries.asked", lambda n: f"{n} queries asked, {counters['queries.replies']} replies let go"),
        ("queries.timed_out", lambda n: f"{n} queries timed out"),
        ("tokens.changes", lambda n: f"{n} changes of liveliness tokens offered"),
        ("tokens.cuts", lambda n: f"{n} times all tokens withdrawn by an outage"),
        ("before_epoch", lambda n: f"{n} messages before the beginning"),
        ("unsent", lambda n: f"{n} messages that Zenoh refused to send"),
        ("queries.unsent", lambda n: f"{n} replies after the end of their query"),
        ("leaks", ways_past),
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
