"""Logs of a run: their state, and messages in their gaps, which are left out instead of called lost."""

from collections.abc import Collection, Iterable, Mapping
from typing import Any, Self, get_args

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Direction, Side
from tis.common.errors import problem
from tis.common.records import COUNTERS
from tis.deploy.logs.coverage import WRITTEN_WITHIN_NS, Span, lies_in
from tis.deploy.logs.read.columns import Ints, joined
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.packets import link_fates, link_releases
from tis.deploy.report.section import Section, means


class LogState(Section):
    """The log of a side."""

    state: str = means("State of the side's log; `complete` when nothing is missing.")
    file: str | None = means("File that was read; a recovered log is read in place of a damaged one.")
    unknown_s: list[list[float | None]] = means("Stretches of run time of which the log does not tell, from and to.")
    away_s: list[list[float | None]] = means(
        "Stretches of run time without the side, until it was started anew.", default=[]
    )
    away_counts: bool = means("Whether these count in the figures (`on_rejoin`).", default=False)
    lost_bytes: int | None = means("Bytes that could not be read.")


def log_states(logs: RunLogs) -> dict[Side, LogState]:
    """Return by side the log file that was read, its state, and the spans of run time that it lacks."""
    missing = LogState(state="missing", file=None, unknown_s=[[0.0, None]], lost_bytes=None)
    found = {
        side: LogState.model_validate({**log.coverage.summary(), "file": log.coverage.file or f"{side}.mcap"})
        for side, log in logs.sides.items()
    }
    return {side: found.get(side, missing) for side in get_args(Side)}


def counters_of(logs: RunLogs, side: Side) -> dict[str, Any]:
    """Return a side's counters by name; empty without its log."""
    return {row["name"]: row["value"] for row in logs.of(side, COUNTERS)}


def count_of(logs: RunLogs, side: Side, name: str) -> int | None:
    """Return the first value of a side's counter; None without it."""
    return next((row["value"] for row in logs.of(side, COUNTERS) if row["name"] == name), None)


def bypass_problems(logs: RunLogs) -> list[str]:
    """Return a problem where netem has found ways past it."""
    n = count_of(logs, "netem", "leaks")
    if not n:
        return []
    ways, were = ("way", "was") if n == 1 else ("ways", "were")
    cure = "let the programs be clients that connect to netem only"
    return [problem(f"{n} {ways} past netem {were} found: messages crossed without it", cure)]


def absence_texts(states: Mapping[Side, LogState]) -> list[str]:
    """Return a sentence on each time without a side that was started anew in mid-run."""
    return [
        f"{side} was away from {begin_s:.2f} to {end_s:.2f} s and was started anew: that time "
        f"{'counts' if log.away_counts else 'is left out'} (on_rejoin)"
        for side, log in states.items()
        for begin_s, end_s in log.away_s
    ]


class LogGaps:
    """The gaps of the logs of one direction, as instants of sending.

    A message is affected when it was sent during a gap of one of the logs, or so shortly before that it may have been
    in flight then: within the longest delay of the direction. Complete logs have no gaps. Oracle: logs with gaps at
    known places, tests/deploy/report/subjects/test_log_gaps.
    """

    def __init__(self, gaps: Iterable[tuple[tuple[Span, ...], int]]) -> None:
        self._gaps = [(unknown, in_flight_ns) for unknown, in_flight_ns in gaps if unknown]

    @classmethod
    def of(cls, logs: RunLogs, direction: Direction, session: str, sides: Collection[Side]) -> Self:
        """Return the gaps of the logs of ``sides`` for one direction, and the times without a side that are left out.

        A missing log has none.
        """
        covered = {side: logs.coverage(side) for side in get_args(Side)}
        gaps = {
            side: spans
            for side, one in covered.items()
            if one is not None and (spans := one.unknown if side in sides else one.left_out)
        }
        longest_ns = _longest_ns(logs, direction, session) if gaps else 0
        sender: Side = "surgeon" if direction == "forward" else "patient"
        # the sender logs at the instant of sending itself, the others after up to the longest delay
        return cls((unknown, 0 if side == sender else longest_ns) for side, unknown in gaps.items())

    @property
    def any(self) -> bool:
        """Tell whether there are any."""
        return bool(self._gaps)

    def affect(self, instants_ns: Ints) -> NDArray[np.bool_]:
        """Mark the instants (N,) of sending, or of being offered, whose message may be missing in a log."""
        hit = np.zeros(len(instants_ns), dtype=np.bool_)
        for unknown, in_flight_ns in self._gaps:
            hit |= lies_in(instants_ns, unknown, WRITTEN_WITHIN_NS + in_flight_ns, WRITTEN_WITHIN_NS)
        return hit

    def affected(self, *stations: tuple[Ints, Ints]) -> Ints:
        """Return the affected sequence numbers; each station gives its sequence numbers and their instants, (N,)."""
        return np.unique(joined(seq[self.affect(at_ns)] for seq, at_ns in stations))


def _longest_ns(logs: RunLogs, direction: Direction, session: str) -> int:
    """Return the longest time in flight of a message: as decided, as released and as received."""
    receiver: Side = "patient" if direction == "forward" else "surgeon"
    fates, releases = link_fates(logs, direction), link_releases(logs, direction)
    decided_ns = (fates.release_ns - fates.offered_ns)[fates.release_ns > 0]
    released_ns = (releases.released_ns - releases.offered_ns)[releases.released_ns > 0]
    received_ns = [one.log_ns - one.sent_ns for one in logs.messages(receiver, direction, session).values()]
    return max(int(ns.max(initial=0)) for ns in (decided_ns, fates.delay_ns, released_ns, *received_ns))
