"""Coverage of run time by a log: complete, or with gaps after damage."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from tis.common.clocks import ClockModel
from tis.common.errors import problem
from tis.common.runtime.chunk_writer import Ints
from tis.common.runtime.mcap_log import is_being_written
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.deploy.logs.log_file import LogFile

RECOVERED: Final = "recovered"
"""Name of the metadata record in which a recovered log states its gaps."""

FOREVER: Final = int(np.iinfo(np.int64).max)

WRITTEN_WITHIN_NS: Final = 500 * NS_PER_MS
"""Longest time from an event to its record: netem batches 200 ms, the others a tick."""

LOST_BY_KILL_NS: Final = NS_PER_S
"""Longest time before its end of which a killed process may not have written its records."""

_MAX_DIGITS: Final = 18  # which fit int64

Span = tuple[int, int]
"""Begin and end in ns of run time; `FOREVER`: up to the log's end."""


@dataclass(frozen=True)
class Coverage:
    """The gaps of a log. ``damage`` is of the file that was read, ``origin`` that of the file it was recovered from.

    ``unknown`` are the spans in which records may be missing, ascending; ``lost_bytes`` is None if not counted.
    ``away`` are the spans without the side, between the parts of a log that was begun anew; where ``away_counts``, it
    is known that nothing happened in them.
    """

    file: str = ""
    damage: str | None = None
    origin: str | None = None
    unknown: tuple[Span, ...] = ()
    lost_bytes: int | None = None
    away: tuple[Span, ...] = ()
    away_counts: bool = True
    being_written: bool = False

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
        being_written = log.damage is not None and is_being_written(log.path)
        origin, n_lost = marked.get("damage"), lost_bytes_of(marked)
        return cls(log.path.name, log.damage, origin, unknown, n_lost, being_written=being_written)

    @property
    def whole(self) -> bool:
        """Tell whether the log has no gap."""
        return not self.unknown

    @property
    def void(self) -> bool:
        """Tell whether the log has no records at all, as that of a side killed at its start."""
        return bool(self.unknown) and self.unknown[0] == (0, FOREVER)

    def continued(self, last_ns: int, part: Self, joined_ns: int, counts: bool) -> Self:
        """Return the coverage of this log up to ``last_ns`` together with its next part.

        Parameters
        ----------
        last_ns
            Instant of the last message of this log.
        part
            The coverage of the next part.
        joined_ns
            Instant from which the next part holds the side's records.
        counts
            Whether the time in between counts in the figures. Then only what a killed process had not written is
            unknown.
        """
        joined_ns = max(joined_ns, last_ns)
        was_cut = bool(self.unknown) and self.unknown[-1][1] == FOREVER
        lost: tuple[Span, ...] = ((last_ns, joined_ns),)
        if counts:
            lost = ((last_ns, min(last_ns + LOST_BY_KILL_NS, joined_ns)),) if was_cut else ()
        return replace(
            part,
            file=self.file,
            damage=part.damage if was_cut else self.damage or part.damage,
            origin=self.origin or part.origin,
            unknown=(*(span for span in self.unknown if span[1] != FOREVER), *lost, *part.unknown),
            away=(*self.away, (last_ns, joined_ns)),
            away_counts=counts,
        )

    @property
    def left_out(self) -> tuple[Span, ...]:
        """Return the spans without the side that figures leave out."""
        return () if self.away_counts else self.away

    @property
    def problem(self) -> str | None:
        """Return the problem that makes a run with this log invalid; None without gaps but those of a restart."""
        unknown = tuple(span for span in self.unknown if not any(a <= span[0] and span[1] <= b for a, b in self.away))
        if self.being_written:
            return problem("log is still being written: the run is going on", "repeat this when it has ended")
        if self.damage is not None:
            beyond = f"; {spans_text(unknown)}" if unknown and not self.void else ""
            text = f"log is damaged ({self.damage}){beyond}"
            return problem(text, "tis recover copies what can be read to a new file")
        if unknown:
            text = f"log was recovered from a damaged one ({self.file}); {spans_text(unknown)}"
            return problem(text, "the figures leave that out, and the run stays invalid")
        return None

    def aligned(self, clock: ClockModel) -> Self:
        """Return the coverage with its spans on the reference clock."""
        if clock.shared:
            return self
        return replace(self, unknown=_aligned(self.unknown, clock), away=_aligned(self.away, clock))

    def summary(self) -> dict[str, object]:
        """Return the summary's entry; ``unknown_s`` lists spans, [begin, None] for one up to the end."""
        state = "empty" if self.void else "damaged" if self.damage else "recovered" if self.origin else "complete"
        spans_s = {
            name: [[a / NS_PER_S, None if b == FOREVER else b / NS_PER_S] for a, b in spans]
            for name, spans in (("unknown_s", self.unknown), ("away_s", self.away))
        }
        about = {"away_counts": self.away_counts, "lost_bytes": self.lost_bytes}
        return {"state": state, "file": self.file, **spans_s, **about}


def _aligned(spans: tuple[Span, ...], clock: ClockModel) -> tuple[Span, ...]:
    # all edges in one call, then back into spans
    edges = np.array([edge for span in spans for edge in span if edge != FOREVER], dtype=np.int64)
    moved = iter(clock.to_reference_ns(edges).tolist())
    return tuple((next(moved), until if until == FOREVER else next(moved)) for _, until in spans)


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
