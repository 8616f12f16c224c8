"""A sleep that ends on time: asleep until shortly before, then polling the clock; or earlier, when somebody rings."""

import os
import select
import time
from typing import Final

from common.runtime.clock import Clock

_LONGEST_SLEEP_S: Final = 0.5


class Alarm:
    """One thread sleeps, any other may ring, also a callback or a signal handler.

    ``lead_ns`` is by how much it wakes too early, to poll the clock for the rest (`netem.bridge.lead` measures it).
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
        if asleep_s > 0:
            if select.select((self._rings,), (), (), min(asleep_s, _LONGEST_SLEEP_S))[0]:
                os.eventfd_read(self._rings)
                return
            if asleep_s > _LONGEST_SLEEP_S:
                return
        while clock.now_ns() < until_ns:
            time.sleep(0)  # gives callbacks the interpreter
