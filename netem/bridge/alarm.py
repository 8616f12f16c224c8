"""The sleep of a thread that must wake at an instant, and the measure of how late this machine wakes one."""

import os
import select
import time
from typing import Final

from tis.common.runtime.clock import Clock
from tis.common.runtime.scheduling import sharpen_timers

_MAX_SLEEP_S: Final = 0.5
_N_SLEEPS: Final = 100
_SLEEP_NS: Final = 500_000
_PUNCTUAL_SHARE: Final = 0.9
_MAX_LEAD_NS: Final = 150_000


class Alarm:
    """A sleep for one thread, which any other thread, a callback or a signal handler may end.

    ``lead_ns`` is the time by which it wakes early, to poll the clock for the rest (`measure_lead_ns`).
    """

    def __init__(self) -> None:
        self.lead_ns = 0
        self._rings = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)

    def ring(self) -> None:
        """End the sleep, or the next one."""
        os.eventfd_write(self._rings, 1)

    def sleep(self, clock: Clock, until_ns: int) -> None:
        """Sleep until run time ``until_ns`` or a ring, at most half a second."""
        asleep_s = (until_ns - clock.now_ns() - self.lead_ns) * 1e-9
        if asleep_s > 0 and select.select((self._rings,), (), (), min(asleep_s, _MAX_SLEEP_S))[0]:
            os.eventfd_read(self._rings)
        elif asleep_s <= _MAX_SLEEP_S:
            while clock.now_ns() < until_ns:
                time.sleep(0)  # yields the interpreter lock to callbacks


def measure_lead_ns() -> int:
    """Measure for a twentieth of a second how late this machine wakes a thread; return the 90th percentile, in ns.

    A thread that sleeps that much less and polls the clock for the rest is punctual nine times in ten. The result is
    bounded, since polling costs processor time.
    """
    sharpen_timers()
    alarm, late_ns = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC), list[int]()
    try:
        for _ in range(_N_SLEEPS):
            due_ns = time.monotonic_ns() + _SLEEP_NS
            select.select((alarm,), (), (), _SLEEP_NS * 1e-9)
            late_ns.append(time.monotonic_ns() - due_ns)
    finally:
        os.close(alarm)
    return min(_MAX_LEAD_NS, max(0, sorted(late_ns)[int(_PUNCTUAL_SHARE * _N_SLEEPS)]))
