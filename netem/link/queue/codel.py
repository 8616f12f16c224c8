"""CoDel, controlled delay (RFC 8289): active queue management by the time messages wait, not by their number.

A queue is standing when the wait has been at or above a target for a whole interval. Then one message is dropped, and
further ones after gaps of interval / sqrt(count) until the wait falls below the target.
"""

from math import isqrt
from typing import Final, Self

from tis.common.scenario.network import capacity
from tis.common.units import ms_to_ns

_SOON_INTERVALS: Final = 16
"""A dropping state that begins within so many intervals of the last drop resumes from the earlier count."""


class CoDel:
    """The state of one queue; `drops` is called for each message when it is at the head, in order.

    Oracle: a simulation in another form, tests/netem/link/queue/test_codel.
    """

    __slots__ = (
        "_above_until_ns", "_count", "_count_at_entry", "_dropping", "_interval_ns", "_next_drop_ns", "_owes_gap",
        "_target_ns",
    )  # fmt: skip

    def __init__(self, target_ns: int, interval_ns: int) -> None:
        self._target_ns = target_ns
        self._interval_ns = interval_ns
        self._above_until_ns: int | None = None  # when the wait will have exceeded the target for an interval
        self._dropping = False
        self._count = 0  # drops in this dropping state, and those carried over into it
        self._count_at_entry = 0
        self._next_drop_ns = 0
        self._owes_gap = False  # the gap after the last drop begins once the next message waits too long

    @classmethod
    def of(cls, part: capacity.CoDel) -> Self:
        """Return the initial state for a scenario's parameters."""
        return cls(ms_to_ns(part.target_ms), ms_to_ns(part.interval_ms))

    def drops(self, waited_ns: int, is_short: bool, now_ns: int) -> bool:
        """Tell whether the message at the head is dropped at ``now_ns`` after a wait of ``waited_ns``.

        ``is_short``: the bytes behind it are at most the longest message seen. Then the line would soon be idle, and
        nothing is dropped (section 5.6 of the RFC). So the last message in a queue always passes, and an empty queue
        needs no reset.
        """
        if not self._is_standing(waited_ns, is_short, now_ns):
            self._dropping = False
            return False
        if not self._dropping:
            self._begin(now_ns)
            return True
        if self._owes_gap:
            self._next_drop_ns += self._gap_ns()
            self._owes_gap = False
        if now_ns < self._next_drop_ns:
            return False
        self._count += 1
        self._owes_gap = True
        return True

    def _is_standing(self, waited_ns: int, is_short: bool, now_ns: int) -> bool:
        if waited_ns < self._target_ns or is_short:
            self._above_until_ns = None
            return False
        if self._above_until_ns is None:
            self._above_until_ns = now_ns + self._interval_ns
            return False
        return now_ns >= self._above_until_ns

    def _begin(self, now_ns: int) -> None:
        needed = self._count - self._count_at_entry
        is_soon = now_ns - self._next_drop_ns < _SOON_INTERVALS * self._interval_ns
        self._count = self._count_at_entry = needed if needed > 1 and is_soon else 1
        self._next_drop_ns = now_ns + self._gap_ns()
        self._dropping = True
        self._owes_gap = False

    def _gap_ns(self) -> int:
        return isqrt(self._interval_ns**2 // self._count)
