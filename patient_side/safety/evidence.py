"""Evidence of forgery: two contents under one number, and set points that the patient did not send.

Nobody who is honest sends either. A few within a second are evidence; a single one may be a fault of a program.
"""

from collections import deque
from dataclasses import dataclass, field
from typing import Final

from tis.common.units import NS_PER_S

N_EVIDENCE: Final = 3
"""Contradictions within a second that are evidence."""
_WITHIN_NS: Final = NS_PER_S
_MAX_TOLD_PER_S: Final = 10


@dataclass
class Evidence:
    """Contradictions of one kind, by their arrivals; ``begun_ns`` is the arrival that first made them evidence.

    Oracle: arrivals with literal instants, test_evidence.
    """

    n: int = 0
    begun_ns: int | None = None
    _until_ns: int = 0
    _latest_ns: deque[int] = field(default_factory=lambda: deque(maxlen=N_EVIDENCE), repr=False)
    _told_ns: deque[int] = field(default_factory=lambda: deque(maxlen=_MAX_TOLD_PER_S), repr=False)

    def note(self, recv_ns: int) -> None:
        """Count a contradiction: three within a second are evidence, and each further one prolongs it."""
        self.n += 1
        self._latest_ns.append(recv_ns)
        is_new = len(self._latest_ns) == N_EVIDENCE and recv_ns - self._latest_ns[0] < _WITHIN_NS
        if is_new or self.holds(recv_ns):
            self._until_ns = recv_ns + _WITHIN_NS
            self.begun_ns = recv_ns if self.begun_ns is None else self.begun_ns

    def holds(self, now_ns: int) -> bool:
        """Tell whether there is evidence now, which there is until a second after the last contradiction."""
        return now_ns < self._until_ns

    def is_to_be_logged(self, recv_ns: int) -> bool:
        """Tell whether one more is to be logged, where a flood must not fill the log: ten a second are."""
        if len(self._told_ns) == _MAX_TOLD_PER_S and recv_ns - self._told_ns[0] < NS_PER_S:
            return False
        self._told_ns.append(recv_ns)
        return True
