"""The congestion window of a TCP sender: how many packets may be under way.

Linux's rules: slow start, Reno (RFC 5681) or CUBIC (RFC 9438) after it, growth only while the window is used, and
proportional rate reduction during a recovery (RFC 6937). Integers, and floats by basic operations alone, so that
every machine finds the same window.
"""

from math import cbrt
from typing import Final, Literal

from tis.common.units import NS_PER_MS

Congestion = Literal["cubic", "reno", "none"]

OPEN: Final = 1 << 60
"""A window that limits nothing."""

_FIRST: Final = 10
_LEAST: Final = 2
_PERMILLE_AFTER: Final = {"cubic": 717, "reno": 512}  # in 1024ths, what is left of the window after a loss
_CUBIC_C: Final = 0.4
_FRIENDLY: Final = (1024 + 717) / (1024 - 717) / 3  # windows of acknowledgements in which Reno would add a packet
_FIRST_CUBIC_COUNT: Final = 20
_LEAST_COUNT: Final = 2


class Window:
    """The window of one connection, in packets; ``none`` limits only what follows a timeout.

    Oracle: literal windows by the RFCs' formulas, tests/netem/stages/loss/test_congestion.
    """

    def __init__(self, kind: Congestion) -> None:
        self.kind: Congestion = kind
        self.size = OPEN if kind == "none" else _FIRST
        self._threshold = OPEN
        self._count = 0
        self._reduces = False
        self._before = self._delivered = self._sent = 0
        self._is_used = False
        self._most_out = 0
        self._used_upto = 0
        self._reset()

    def _reset(self) -> None:
        self._epoch_ns: int | None = None
        self._greatest = self._friendly = self._origin = 0
        self._k_ms = 0
        self._acknowledged = 0.0

    def left(self, n: int) -> None:
        """Count packets that were sent."""
        self._sent += n

    def used(self, pipe: int, n_out: int, first: int, upto: int) -> None:
        """Note how far the window is used: packets under way, and those sent and not acknowledged in order.

        ``first``, ``upto``: numbers of the first of these and of the last sent; what was used counts for a window.
        """
        is_used = pipe >= self.size
        if first > self._used_upto or is_used or (not self._is_used and n_out > self._most_out):
            self._is_used, self._most_out, self._used_upto = is_used, n_out, upto

    def reduce(self) -> None:
        """Begin the reduction that a recovery makes."""
        if self.kind != "none":
            self._before, self._delivered, self._sent = self.size, 0, 0
            self._threshold, self._reduces = self._after_loss(), True

    def end(self) -> None:
        """End a recovery."""
        if self.kind == "none":
            self.size = OPEN
        elif self._reduces:
            self.size, self._reduces = self._threshold, False

    def timed_out(self, pipe: int, is_new: bool) -> None:
        """Begin anew with one packet; ``is_new``: no recovery was under way."""
        if self.kind != "none":
            if is_new:
                self._threshold = self._after_loss()
            self._reset()
        self.size, self._reduces, self._count = pipe + 1, False, 0

    def delivered(self, n: int, pipe: int, moved: bool, lost: bool, at_ns: int, rtt_ns: int) -> None:
        """Count ``n`` packets delivered; ``moved``: in order, ``lost``: others were found lost at the same time."""
        if self._reduces:
            self._delivered += n
            room = self._threshold - pipe
            if room < 0:
                may = -(-self._threshold * self._delivered // self._before) - self._sent
            else:
                may = min(room, max(self._delivered - self._sent, n) + (moved and not lost))
            self.size = pipe + max(may, 0 if self._sent else 1)
        elif moved and self.size < OPEN:
            self._grow(n, at_ns, rtt_ns)

    def _grow(self, n: int, at_ns: int, rtt_ns: int) -> None:
        slow = self.size < self._threshold
        if not (self._is_used or (slow and self.size < 2 * self._most_out)):
            return
        if slow:
            grown = min(self.size + n, self._threshold)
            n -= grown - self.size
            self.size = grown
        if n <= 0:
            return
        count = self.size if self.kind == "reno" else self._cubic_count(n, at_ns, rtt_ns)
        if self._count >= count:
            self._count, self.size = 0, self.size + 1
        self._count += n
        self.size, self._count = self.size + self._count // count, self._count % count

    def _cubic_count(self, n: int, at_ns: int, rtt_ns: int) -> int:
        """Return how many packets must be delivered for one more in the window."""
        if self._epoch_ns is None:
            self._epoch_ns, self._acknowledged, self._friendly = at_ns, 0.0, self.size
            self._origin = max(self._greatest, self.size)
            self._k_ms = _cube_root(round((self._origin - self.size) * 1e9 / _CUBIC_C))
        self._acknowledged += n
        s = ((at_ns - self._epoch_ns + rtt_ns) // NS_PER_MS - self._k_ms) / 1000
        above = self._origin + _CUBIC_C * s * s * s - self.size
        count = self.size / above if above > 0 else 100.0 * self.size
        if not self._greatest:
            count = min(count, _FIRST_CUBIC_COUNT)
        each = self.size * _FRIENDLY
        while self._acknowledged > each:
            self._acknowledged -= each
            self._friendly += 1
        if self._friendly > self.size:
            count = min(count, self.size / (self._friendly - self.size))
        return max(int(count), _LEAST_COUNT)

    def _after_loss(self) -> int:
        """Return the window to which a loss reduces this one, and remember this one."""
        left = _PERMILLE_AFTER[self.kind]
        self._epoch_ns = None
        self._greatest = self.size * (1024 + left) // 2048 if self.size < self._greatest else self.size
        return max(self.size * left // 1024, _LEAST)


def _cube_root(of: int) -> int:
    """Return the integer part of a cube root."""
    root = round(cbrt(of))
    while root**3 > of:
        root -= 1
    while (root + 1) ** 3 <= of:
        root += 1
    return root
