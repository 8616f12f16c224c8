"""Clocks in run time: integer nanoseconds since the run's epoch, on a monotonic clock that a test may falsify.

``TIS_CLOCK_SKEW=OFFSET_S:DRIFT_PPM`` in the environment of a side's process, like ``3:50``, puts its clock 3 s ahead
and 50 ppm fast, and changes its boot id as if it ran on another host. ``0:0:10@20`` steps it by 10 s, 20 s after its
first reading.
"""

import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

from tis.common.errors import Fault, InputError

SKEW_VARIABLE: Final = "TIS_CLOCK_SKEW"


def skewed(text: str, true_ns: Callable[[], int]) -> Callable[[], int]:
    """Return a clock that shows ``t + offset + t * drift`` where ``true_ns`` shows t; ``text`` gives both errors.

    An invalid ``text`` raises `InputError` at the first call, since errors at import time are not reported.
    """
    offset_text, _, drift_text = text.partition(":")
    drift_text, _, step_text = drift_text.partition(":")
    step, _, after = step_text.partition("@")
    try:
        offset_s, drift_ppm = float(offset_text), float(drift_text)
        drift_ppb, offset_ns = round(drift_ppm * 1000), round(offset_s * 10**9)
        step_ns, after_ns = (round(float(step) * 10**9), round(float(after) * 10**9)) if step_text else (0, 0)
    except (ValueError, OverflowError):
        offset_ns, drift_ppm, drift_ppb, step_ns, after_ns = 0, math.inf, 0, 0, 0

    if not abs(drift_ppm) < 10**6:

        def refuse() -> int:
            raise InputError(
                Fault(SKEW_VARIABLE, "", "must read OFFSET_S:DRIFT_PPM[:STEP_S@AFTER_S], as in 3:50", text)
            )

        return refuse

    if not step_ns:

        def wrong_ns() -> int:
            ns = true_ns()
            return ns + offset_ns + ns * drift_ppb // 10**9

        return wrong_ns
    stepped_at_ns = true_ns() + after_ns

    def stepped_ns() -> int:
        ns = true_ns()
        return ns + offset_ns + ns * drift_ppb // 10**9 + (step_ns if ns >= stepped_at_ns else 0)

    return stepped_ns


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
