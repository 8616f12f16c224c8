"""Serialisation at a bit rate, in whole nanoseconds without drift."""

from fractions import Fraction
from typing import Final

_NS_PER_BYTE_AT_1_KBIT_S: Final = 8_000_000


class Line:
    """A line in exact arithmetic: the fraction of a nanosecond lost by rounding an end up is carried over.

    So n successive bytes take ``n * 8e6 / kbit_s`` ns, rounded up once, for any division into messages and for any
    number of changes of the bit rate (oracle: fractions, tests/netem/link/queue/test_line and
    tests/netem/link/test_changing_rate). The bit rate is the exact value of its decimal notation; None: no time.
    """

    __slots__ = ("_numerator", "_spare", "_unit", "free_ns")

    def __init__(self, kbit_s: float | None) -> None:
        self._numerator, self._unit = _per_byte(kbit_s)
        self.free_ns = 0
        """The first whole nanosecond at which everything has been sent."""
        self._spare = 0  # in 1/unit ns, 0 to unit - 1: how much earlier than ``free_ns`` the line is free

    def send(self, n_bytes: int, ready_ns: int) -> int:
        """Send a message that is ready at ``ready_ns``, after the earlier ones; return the new ``free_ns``."""
        begin_ns, spare = (self.free_ns, self._spare) if ready_ns < self.free_ns else (ready_ns, 0)
        whole, self._spare = divmod(spare - n_bytes * self._numerator, self._unit)
        self.free_ns = begin_ns - whole
        return self.free_ns

    def left(self, now_ns: int) -> Fraction:
        """Return the bytes that are left at ``now_ns``, exactly."""
        if self.free_ns <= now_ns:
            return Fraction(0)
        return Fraction((self.free_ns - now_ns) * self._unit - self._spare, self._numerator)

    def resume(self, left: Fraction, now_ns: int) -> None:
        """Send the bytes that another transmission left at ``now_ns``."""
        # The bytes left are a fraction with the old numerator as denominator, so the unit becomes finer. Instants of
        # changes are whole ns, so it does not become finer than all numerators of a busy period together require.
        self._numerator, self._unit = self._numerator * left.denominator, self._unit * left.denominator
        whole, self._spare = divmod(int(-left * self._numerator), self._unit)
        self.free_ns = now_ns - whole


def _per_byte(kbit_s: float | None) -> tuple[int, int]:
    """Return the ns per byte as numerator and denominator."""
    if kbit_s is None:
        return 0, 1
    return (_NS_PER_BYTE_AT_1_KBIT_S / Fraction(str(kbit_s))).as_integer_ratio()
