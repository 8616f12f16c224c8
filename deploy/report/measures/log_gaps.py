"""Messages of which a damaged log may not tell: they are left out, and not taken for lost by the network."""

from collections.abc import Collection, Iterable
from typing import Self

import numpy as np
from numpy.typing import NDArray

from common.channels import Direction, Side
from deploy.logs.coverage import WRITTEN_WITHIN_NS, Span, lies_in
from deploy.logs.read.batches import link_fates, link_releases
from deploy.logs.read.load import Ints, RunLogs


class LogGaps:
    """One direction's messages that a damaged log may not tell of, by when they were sent.

    A message counts as untold when it was sent while one of the logs has a hole, or so shortly before that it may
    have been under way then: within the longest delay of the direction. Nothing is untold where all logs are whole.
    Oracle: logs cut and holed at known places, tests/deploy/report/measures/test_log_gaps.
    """

    def __init__(self, holes: Iterable[tuple[tuple[Span, ...], int]]) -> None:
        self._holes = [(unknown, under_way_ns) for unknown, under_way_ns in holes if unknown]

    @classmethod
    def of(cls, logs: RunLogs, direction: Direction, session: str, sides: Collection[Side]) -> Self:
        """Return those of one direction that the logs of ``sides`` do not tell of; a missing log has no holes."""
        covered = {side: logs.coverage(side) for side in sides}
        holes = {side: one.unknown for side, one in covered.items() if one is not None and not one.whole}
        longest_ns = _longest_ns(logs, direction, session) if holes else 0
        sender: Side = "surgeon" if direction == "forward" else "patient"
        return cls((unknown, 0 if side == sender else longest_ns) for side, unknown in holes.items())

    @property
    def any(self) -> bool:
        """Tell whether there may be any."""
        return bool(self._holes)

    def sent_at(self, instants_ns: Ints) -> NDArray[np.bool_]:
        """Mark the instants (N,) of sending, or of being offered, of which not every log tells."""
        hit = np.zeros(len(instants_ns), dtype=np.bool_)
        for unknown, under_way_ns in self._holes:
            hit |= lies_in(instants_ns, unknown, WRITTEN_WITHIN_NS + under_way_ns, WRITTEN_WITHIN_NS)
        return hit

    def numbers(self, *stations: tuple[Ints, Ints]) -> Ints:
        """Return the sequence numbers that a station met at an untold instant; of each station numbers, instants."""
        nothing = np.empty(0, dtype=np.int64)
        if not self._holes:
            return nothing
        return np.unique(np.concatenate([nothing, *(seq[self.sent_at(at_ns)] for seq, at_ns in stations)]))


def _longest_ns(logs: RunLogs, direction: Direction, session: str) -> int:
    """Return the longest time that a message was under way, as decided, as released and as received."""
    receiver: Side = "patient" if direction == "forward" else "surgeon"
    fates, releases = link_fates(logs, direction), link_releases(logs, direction)
    decided_ns = (fates.release_ns - fates.offered_ns)[fates.release_ns > 0]
    released_ns = (releases.released_ns - releases.offered_ns)[releases.released_ns > 0]
    received_ns = [one.log_ns - one.sent_ns for one in logs.messages(receiver, direction, session).values()]
    return max(int(ns.max(initial=0)) for ns in (decided_ns, fates.delay_ns, released_ns, *received_ns))
