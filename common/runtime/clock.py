"""Clocks in run time: integer nanoseconds since the run's epoch."""

import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

from tis.common.runtime.clock_skew import SKEW_VARIABLE, skewed

_SKEW: Final = os.environ.get(SKEW_VARIABLE, "")

monotonic_ns: Final = skewed(_SKEW, time.monotonic_ns) if _SKEW else time.monotonic_ns
"""The monotonic clock of this host, in ns; all stamps that are compared with another host's use it."""


class Clock(Protocol):
    """A source of run time."""

    def now_ns(self) -> int:
        """Return the run time, in ns."""


@dataclass(frozen=True)
class WallClock:
    """The monotonic clock of this host, counted from ``epoch_ns`` on that clock."""

    epoch_ns: int

    def now_ns(self) -> int:
        """Return the run time, in ns; negative before the epoch."""
        return monotonic_ns() - self.epoch_ns

    def unix_epoch_ns(self) -> int:
        """Return the instant of the run's epoch, in ns since 1970 by this host's calendar clock."""
        return time.time_ns() - self.now_ns()


@dataclass
class VirtualClock:
    """A clock that moves only by `advance`."""

    _now_ns: int = 0

    def now_ns(self) -> int:
        """Return the run time, in ns."""
        return self._now_ns

    def advance(self, to_ns: int) -> None:
        """Move forward to ``to_ns``; never back."""
        self._now_ns = max(self._now_ns, to_ns)


def boot_id() -> str:
    """Return the identifier of this boot of the host's kernel: equal ids mean the same monotonic clock."""
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    except OSError:
        return ""
    return f"{boot} {_SKEW}" if _SKEW else boot
