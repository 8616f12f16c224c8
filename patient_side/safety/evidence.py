"""Evidence of forgery: two contents under one number, and set points that the patient did not send.

Nobody who is honest sends either. A few within a second are evidence; a single one may be a fault of a program.
"""

from collections import deque
from dataclasses import dataclass, field
from typing import Final

from common.units import NS_PER_S

N_EVIDENCE: Final = 3
"""Contradictions within a second that are evidence."""
_WITHIN_NS: Final = NS_PER_S
_MAX_NOTED_PER_S: Final = 10


@dataclass
class Evidence:
    """Contradictions of one kind, by their arrivals; ``begun_ns`` is the arrival that first made them evidence.

    Oracle: arrivals with literal instants, test_evidence.
    """

    n: int = 0
    begun_ns: int | None = None
    _latest_ns: deque[int] = field(default_factory=lambda: deque(maxlen=N_EVIDENCE), repr=False)
    _noted_ns: deque[int] = field(default_factory=lambda: deque(maxlen=_MAX_NOTED_PER_S), repr=False)

    def note(self, recv_ns: int) -> bool:
        """Count a contradiction; return whether it is to be logged: only ten a second are."""
        self.n += 1
        self._latest_ns.append(recv_ns)
        if self.begun_ns is None and self.holds(recv_ns):
            self.begun_ns = recv_ns
        is_logged = len(self._noted_ns) < _MAX_NOTED_PER_S or recv_ns - self._noted_ns[0] >= NS_PER_S
        if is_logged:
            self._noted_ns.append(recv_ns)
        return is_logged

    def holds(self, now_ns: int) -> bool:
        """Tell whether there is evidence now: it ends a second after the contradictions have become few."""
        return len(self._latest_ns) == N_EVIDENCE and now_ns - self._latest_ns[0] < _WITHIN_NS
