"""What a side says while it lives: lines for people on stderr, or events for `tis run` on stdout."""

import json
import sys
import threading
from collections.abc import Mapping, Sequence
from typing import Any

from common.channels import Side


class Status:
    """Says each thing once; never from the loop."""

    def __init__(self, side: Side, as_events: bool) -> None:
        self.side = side
        self._as_events = as_events
        self._last = ""
        self._lock = threading.Lock()

    def waiting(self, whom: str) -> None:
        """Say whom this side waits for."""
        self._say("waiting", f"waiting for {whom}", whom=whom)

    def ready(self) -> None:
        """Say that this side is ready to begin."""
        self._say("ready", "ready")

    def running(self, duration_s: float, log: str) -> None:
        """Say that the epoch is agreed on."""
        self._say("running", f"running for {duration_s:g} s, logging to {log}", duration_s=duration_s)

    def warning(self, text: str) -> None:
        """Say something the user should know, that does not end the run."""
        self._say("warning", f"warning: {text}", warning=text)

    def progress(self, now_s: float, counters: Mapping[str, int]) -> None:
        """Say how far the run is; people are told at the end only."""
        if self._as_events:
            self._say("progress", "", now_s=round(now_s, 3), counters=dict(counters))

    def ended(self, counters: Mapping[str, int]) -> None:
        """Say that the run is over and the log is closed."""
        counts = ", ".join(f"{name} {value}" for name, value in counters.items() if value)
        self._say("ended", f"done: {counts}", counters=dict(counters))

    def failed(self, exit_code: int, reasons: Sequence[str]) -> None:
        """Say why the side cannot go on."""
        self._say("failed", "\n".join(reasons), exit_code=exit_code, reasons=list(reasons))

    def _say(self, event: str, text: str, **details: Any) -> None:
        with self._lock:
            if self._as_events:
                line = json.dumps({"side": self.side, "event": event} | details)
                print(line, flush=True)  # noqa: T201  (standard output is the event channel)
            elif text != self._last:
                self._last = text
                head = "" if text.startswith(f"{self.side}: ") else f"{self.side}: "
                print(f"{head}{text}", file=sys.stderr, flush=True)  # noqa: T201
