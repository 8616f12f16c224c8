"""Status reports of a side: lines on stderr for users, or JSON events on stdout for `tis run`."""

import contextlib
import json
import sys
import threading
from collections.abc import Mapping, Sequence
from typing import Any, Final

from tis.common.channels import Side
from tis.common.errors import printable
from tis.common.units import NS_PER_S

BYPASS: Final = "bypass"
"""Kind of a warning of a way past the emulator."""


def warning_line(text: str, kind: str | None = None) -> str:
    """Return a warning as a line has it behind the side's name, with its kind where it has one."""
    return f"warning: {text}" if kind is None else f"warning ({kind}): {text}"


class Status:
    """Reports each change once; not to be called from the loop."""

    def __init__(self, side: Side, as_events: bool) -> None:
        self.side = side
        self._as_events = as_events
        self._last = ""
        self._lock = threading.Lock()

    def waiting(self, whom: str) -> None:
        """Report for whom this side waits."""
        self._report("waiting", f"waiting for {whom}", whom=whom)

    def ready(self) -> None:
        """Report that this side is ready to begin."""
        self._report("ready", "ready")

    def running(self, duration_s: float, log: str, joined_ns: int | None = None) -> None:
        """Report that the run begins, or that this side is back in it from ``joined_ns`` on."""
        text = f"running for {duration_s:g} s, logging to {log}"
        if joined_ns is not None:
            text = f"back in the run of {duration_s:g} s at {joined_ns / NS_PER_S:.1f} s, logging to {log}"
        self._report("running", text, duration_s=duration_s)

    def warning(self, text: str) -> None:
        """Report a condition that does not end the run; others may have chosen a name or a reason in it."""
        text = printable(text)
        self._report("warning", warning_line(text), warning=text)

    def bypass(self, text: str) -> None:
        """Report a way past the emulator: a warning of a kind of its own, so that others need not know its words."""
        text = printable(text)
        self._report("warning", warning_line(text, BYPASS), warning=text, kind=BYPASS)

    def progress(self, now_s: float, counters: Mapping[str, int]) -> None:
        """Report the progress of the run, as an event only."""
        if self._as_events:
            self._report("progress", "", now_s=round(now_s, 3), counters=dict(counters))

    def ended(self, counters: Mapping[str, int]) -> None:
        """Report that the run is over and the log is closed."""
        counts = ", ".join(f"{name} {value}" for name, value in counters.items() if value)
        self._report("ended", f"done: {counts}", counters=dict(counters))

    def failed(self, exit_code: int, reasons: Sequence[str]) -> None:
        """Report the reasons for which the side ends."""
        reasons = list(map(printable, reasons))
        self._report("failed", "\n".join(reasons), exit_code=exit_code, reasons=reasons)

    def _report(self, event: str, text: str, **details: Any) -> None:
        with self._lock, contextlib.suppress(OSError):  # a terminal that is gone or a full disk ends no run
            if self._as_events:
                line = json.dumps({"side": self.side, "event": event} | details)
                print(line, flush=True)  # noqa: T201  (standard output is the event channel)
            elif text != self._last:
                self._last = text
                head = "" if text.startswith(f"{self.side}: ") else f"{self.side}: "
                print(f"{head}{text}", file=sys.stderr, flush=True)  # noqa: T201
