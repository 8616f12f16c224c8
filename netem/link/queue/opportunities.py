"""Transmission at recorded opportunities, as mahimahi's link has them."""

from bisect import bisect_right
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray


class Opportunities:
    """A transmission that sends some bytes at each instant of a recording, and nothing between them.

    The rest of an opportunity goes to the next messages that waited for it; what nobody waited for is lost. A message
    that becomes ready at an opportunity waits for the next one. The recording repeats from its last instant on, as in
    mahimahi. Oracle: a loop over single opportunities, tests/netem/link/queue/test_opportunities.

    ``at_ns`` (N,) does not descend, its last element is positive; ``n_bytes`` is what each opportunity sends.
    """

    def __init__(self, at_ns: NDArray[np.int64], n_bytes: int) -> None:
        self.free_ns = 0
        self._at_ns: list[int] = at_ns.tolist()
        self._n_bytes = n_bytes
        self._next = 0  # number of the first opportunity that is not used, over all repetitions
        self._rest = 0  # bytes left of the opportunity at ``free_ns``

    def send(self, n_bytes: int, ready_ns: int) -> int:
        """Send a message that is ready at ``ready_ns``, after the earlier ones; return the new ``free_ns``."""
        if ready_ns >= self.free_ns:
            self._rest = 0
            self._next = max(self._next, self._first_after(ready_ns))
        self._take(n_bytes)
        return self.free_ns

    def left(self, now_ns: int) -> Fraction:
        """Return the bytes that are left at ``now_ns``."""
        if self.free_ns <= now_ns:
            return Fraction(0)
        return Fraction((self._next - self._first_after(now_ns)) * self._n_bytes - self._rest)

    def resume(self, left: Fraction, now_ns: int) -> None:
        """Send the bytes that another transmission left at ``now_ns``; a begun byte is sent again."""
        self._rest, self._next, self.free_ns = 0, self._first_after(now_ns), now_ns
        self._take(-int(-left // 1))

    def _take(self, n_bytes: int) -> None:
        if n_bytes > self._rest:
            n_needed = -(-(n_bytes - self._rest) // self._n_bytes)
            self._next += n_needed
            self._rest += n_needed * self._n_bytes
            self.free_ns = self._instant_ns(self._next - 1)
        self._rest -= n_bytes

    def _first_after(self, now_ns: int) -> int:
        round_number, into_ns = divmod(now_ns, self._at_ns[-1])
        return round_number * len(self._at_ns) + bisect_right(self._at_ns, into_ns)

    def _instant_ns(self, number: int) -> int:
        round_number, index = divmod(number, len(self._at_ns))
        return round_number * self._at_ns[-1] + self._at_ns[index]
