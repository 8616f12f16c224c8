"""A line that sends bytes one after the other at a bit rate, in whole nanoseconds that do not drift."""

from fractions import Fraction
from typing import Final

_NS_PER_BYTE_AT_1_KBIT_S: Final = 8_000_000


class Line:
    """Serialisation in exact arithmetic: the part of a nanosecond that an end is rounded by is carried on.

    So n bytes in a row take ``n * 8e6 / kbit_s`` ns, rounded up once, however they are cut into messages (oracle:
    fractions, tests/netem/link/queue/test_line). The bit rate is taken as the decimal number that it was written as.
    """

    __slots__ = ("_numerator", "_spare", "_unit", "free_ns")

    def __init__(self, kbit_s: float) -> None:
        self._numerator, self._unit = _per_byte(kbit_s)
        self.free_ns = 0
        """The first whole nanosecond at which everything has been sent."""
        self._spare = 0  # the line is really free by so many 1/unit ns sooner; 0 to unit - 1

    def send(self, n_bytes: int, ready_ns: int) -> int:
        """Send a message that is there at ``ready_ns``, after those before it; return its `free_ns`."""
        begin_ns, spare = (self.free_ns, self._spare) if ready_ns < self.free_ns else (ready_ns, 0)
        whole, self._spare = divmod(spare - n_bytes * self._numerator, self._unit)
        self.free_ns = begin_ns - whole
        return self.free_ns

    def set_rate(self, kbit_s: float, now_ns: int) -> None:
        """Send what is not yet sent at ``now_ns`` at another bit rate (rounded up, by less than 1 ns)."""
        numerator, unit = self._numerator, self._unit
        self._numerator, self._unit = _per_byte(kbit_s)
        if self.free_ns <= now_ns:
            self._spare = 0
            return
        left = (self.free_ns - now_ns) * unit - self._spare  # bytes times the old numerator
        whole, self._spare = divmod(-left * self._numerator // numerator, self._unit)
        self.free_ns = now_ns - whole


def _per_byte(kbit_s: float) -> tuple[int, int]:
    """Return the ns that a byte takes as numerator and denominator."""
    return (_NS_PER_BYTE_AT_1_KBIT_S / Fraction(str(kbit_s))).as_integer_ratio()
