"""Coverage of run time by a log: complete, or with gaps after damage."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from common.clocks.model import ClockModel
from common.runtime.mcap_chunks import Ints
from common.units import NS_PER_MS, NS_PER_S
from deploy.logs.log_file import LogFile

RECOVERED: Final = "recovered"
"""Name of the metadata record in which a recovered log states its gaps."""

FOREVER: Final = int(np.iinfo(np.int64).max)

WRITTEN_WITHIN_NS: Final = 500 * NS_PER_MS
"""Longest time from an event to its record: netem batches 200 ms, the others a tick."""

_MAX_DIGITS: Final = 18  # which fit int64

Span = tuple[int, int]
"""Begin and end in ns of run time; `FOREVER`: up to the log's end."""


@dataclass(frozen=True)
class Coverage:
    """The gaps of a log. ``damage`` is of the file that was read, ``origin`` that of the file it was recovered from.

    ``unknown`` are the spans in which records may be missing, ascending; ``lost_bytes`` is None if not counted.
    """

    file: str = ""
    damage: str | None = None
    origin: str | None = None
    unknown: tuple[Span, ...] = ()
    lost_bytes: int | None = None

    @classmethod
    def of(cls, log: LogFile, last_ns: int) -> Self:
        """Return the coverage of a log after reading it; ``last_ns`` is the instant of its last message."""
        marked = log.metadata.get(RECOVERED, {})
        unknown = spans(marked.get("unknown_ns", ""))
        if log.damage is not None and not log.data_ended:
            # cut off: everything after the last message is unknown
            unknown = (*(span for span in unknown if span[0] < last_ns), (last_ns, FOREVER))
        elif log.gap_bytes or log.n_orphans:  # records were dropped, their instants unknown
            unknown = ((0, last_ns),)
        return cls(log.path.name, log.damage, marked.get("damage"), unknown, lost_bytes_of(marked))

    @property
    def whole(self) -> bool:
        """Tell whether the log has no gap."""
        return not self.unknown

    @property
    def void(self) -> bool:
        """Tell whether the log has no records at all, as that of a side killed at its start."""
        return bool(self.unknown) and self.unknown[0] == (0, FOREVER)

    @property
    def problem(self) -> str | None:
        """Return the problem that makes a run with this log invalid; None without gaps."""
        if self.damage is not None:
            beyond = f"; {spans_text(self.unknown)}" if self.unknown and not self.void else ""
            return f"log is damaged ({self.damage}){beyond}"
        if self.unknown:
            return f"log was recovered from a damaged one ({self.file}); {spans_text(self.unknown)}"
        return None

    def aligned(self, clock: ClockModel) -> Self:
        """Return the coverage with its spans on the reference clock."""
        if clock.shared or not self.unknown:
            return self
        # all edges in one call, then back into spans
        edges = np.array([edge for span in self.unknown for edge in span if edge != FOREVER], dtype=np.int64)
        moved = iter(clock.to_reference_ns(edges).tolist())
        unknown = tuple((next(moved), until if until == FOREVER else next(moved)) for _, until in self.unknown)
        return replace(self, unknown=unknown)

    def summary(self) -> dict[str, object]:
        """Return the summary's entry; ``unknown_s`` lists spans, [begin, None] for one up to the end."""
        state = "empty" if self.void else "damaged" if self.damage else "recovered" if self.origin else "complete"
        unknown_s = [[a / NS_PER_S, None if b == FOREVER else b / NS_PER_S] for a, b in self.unknown]
        return {"state": state, "file": self.file, "unknown_s": unknown_s, "lost_bytes": self.lost_bytes}


WHOLE: Final = Coverage()


def damage_text(log: LogFile) -> str | None:
    """Return a line on the damage of a log, after reading it; None for a complete log."""
    if log.damage is not None:
        return f"{log.path.name} is damaged ({log.damage})"
    lost = spans(log.metadata.get(RECOVERED, {}).get("unknown_ns", ""))
    return f"{log.path.name} was recovered from a damaged log; {spans_text(lost, '')}" if lost else None


def recovery_metadata(
    damage: str, of: str, n_bytes: int, lost_bytes: int, unknown: tuple[Span, ...]
) -> Mapping[str, str]:
    """Return the metadata of a recovered log: the damaged file and its losses."""
    ends = [a for a, b in unknown if b == FOREVER]
    found = {"of": of, "of_bytes": str(n_bytes), "damage": damage, "lost_bytes": str(lost_bytes)}
    found["unknown_ns"] = ",".join(f"{a}-{'' if b == FOREVER else b}" for a, b in unknown)
    return found | ({"until_s": f"{ends[0] / NS_PER_S:.3f}"} if ends else {})


def spans(text: str) -> tuple[Span, ...]:
    """Return the spans in recovery metadata; unreadable text means one gap over all time (inverse: the tests)."""
    found = []
    for piece in text.split(",") if text else ():
        begin, dash, end = piece.partition("-")
        since, until = _number(begin), _number(end) if end else FOREVER
        if not dash or since is None or until is None:
            return ((0, FOREVER),)
        found.append((since, until))
    return tuple(found)


def lost_bytes_of(marked: Mapping[str, str]) -> int | None:
    """Return the number of lost bytes in recovery metadata; None where it is missing or unreadable."""
    return _number(marked.get("lost_bytes", ""))


def _number(text: str) -> int | None:
    return int(text) if text.isdecimal() and len(text) <= _MAX_DIGITS else None


def lies_in(instants_ns: Ints, unknown: tuple[Span, ...], before_ns: int, after_ns: int) -> NDArray[np.bool_]:
    """Mark instants (N,) within one of the spans, each widened at its ends."""
    hit = np.zeros(len(instants_ns), dtype=np.bool_)
    for begin, end in unknown:
        hit |= (instants_ns >= begin - before_ns) & (instants_ns <= (end if end == FOREVER else end + after_ns))
    return hit


def spans_text(unknown: tuple[Span, ...], hence: str = ", and figures leave that out") -> str:
    """Return the spans in words."""
    parts = [
        f"after {a / NS_PER_S:.3f} s" if b == FOREVER else f"from {a / NS_PER_S:.3f} to {b / NS_PER_S:.3f} s"
        for a, b in unknown
    ]
    return f"nothing is known {' and '.join(parts)}{hence}"
