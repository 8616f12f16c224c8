"""Zenoh's own log, read in this process: nowhere else does Zenoh say what it refused, and why it cannot connect.

Zenoh logs to standard output. So this process's standard output becomes a pipe, whose lines a thread sorts; what this
process prints itself goes to the former standard output.
"""

import fcntl
import os
import sys
import threading
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from typing import Final, Self, get_args

import zenoh

from tis.common.refusal import REFUSED, UNAUTHORIZED, Refusal, refusal_in, thread_in, trouble_in, zenoh_line

# One line for each denied message, and none for a permitted one.
ROUTER_LEVELS: Final = (
    "warn,zenoh::net::routing::interceptor=trace,zenoh::net::routing::interceptor::access_control=info,"
    "zenoh_transport::unicast::establishment::accept=debug"
)
NAMES_LEVEL: Final = "zenoh::net::routing::interceptor::access_control=trace"
CLIENT_LEVELS: Final = "warn,zenoh::net::runtime::orchestrator=debug"
_VARIABLE: Final = "RUST_LOG"
_PIPE_BYTES: Final = 1 << 20
_CHUNK_BYTES: Final = 1 << 16
_LAST_LINES_S: Final = 1.0


class ZenohLog:
    """The log at certain levels while the block lasts, to be entered before the first session of the process.

    ``take`` gets each line from a thread. Lines that the user asked for, by RUST_LOG, and those of other libraries
    and child processes are passed on.
    """

    def __init__(self, levels: str, take: Callable[[bytes], None]) -> None:
        self._take = take
        self._asked = os.environ.get(_VARIABLE)
        self._levels = levels if self._asked is None else f"{self._asked},{levels}"
        self._thread = threading.Thread(target=self._read, name="zenoh log", daemon=True)
        self._source, self._former, self._stdout = -1, -1, sys.stdout

    def __enter__(self) -> Self:
        """Take standard output over, and let Zenoh log."""
        sys.stdout.flush()
        self._former = os.dup(1)
        self._source, sink = os.pipe()
        with suppress(OSError):  # the limit of an unprivileged user; the default of 64 KiB serves as well
            fcntl.fcntl(sink, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        os.dup2(sink, 1)
        os.close(sink)
        self._stdout = sys.stdout
        sys.stdout = os.fdopen(os.dup(self._former), "w", buffering=1, encoding="utf-8", errors="replace")
        self._thread.start()
        os.environ[_VARIABLE] = self._levels
        zenoh.try_init_log_from_env()  # type: ignore[no-untyped-call]
        return self

    def __exit__(self, *_: object) -> None:
        """Give standard output back and wait for the last lines."""
        with suppress(OSError, ValueError):  # a reader that has gone away
            sys.stdout.close()
        sys.stdout = self._stdout
        os.dup2(self._former, 1)  # the pipe has no writer now, unless a child process inherited it
        self._thread.join(_LAST_LINES_S)
        if not self._thread.is_alive():
            os.close(self._former)
            os.close(self._source)

    def _read(self) -> None:
        rest = b""
        while chunk := os.read(self._source, _CHUNK_BYTES):
            *lines, rest = (rest + chunk).split(b"\n")
            for line in lines:
                with suppress(Exception):  # a thread that ends would let the pipe fill, and block Zenoh
                    self._take(line)
                if self._asked is not None or zenoh_line(line) is None:  # what the user asked for, and others' output
                    with suppress(OSError):
                        os.write(self._former, line + b"\n")
            rest = rest[-_CHUNK_BYTES:]


class RefusalCounter:
    """Refusals of this process's routers by kind; ``on_each`` gets the kind and what is said of it, from a thread.

    Zenoh names the sender of a denied message in a line before it, at a level at which each permitted message has a
    line, too: only if RUST_LOG has `NAMES_LEVEL`.
    """

    def __init__(self, on_each: Callable[[Refusal, bytes], None]) -> None:
        self._on_each = on_each
        self._counts: Counter[Refusal] = Counter()
        self._denied: dict[bytes, bytes] = {}  # the last such line of each thread

    def take(self, line: bytes) -> None:
        """Count a line of the log, if it reports a refusal."""
        kind = refusal_in(line)
        if kind is not None:
            self._counts[kind] += 1
            self._on_each(kind, self._denied.get(thread_in(line), line) if kind == "not_permitted" else line)
        elif UNAUTHORIZED in line:
            self._denied[thread_in(line)] = line

    def add(self, kind: Refusal) -> None:
        """Count a refusal that is netem's own."""
        self._counts[kind] += 1

    def counters(self) -> dict[str, int]:
        """Return the number of refusals by kind, without those that never happened."""
        return {f"{REFUSED}.{kind}": n for kind in get_args(Refusal) if (n := self._counts[kind])}


class ConnectionTrouble:
    """The last reason for which this process could not connect; an empty text without any."""

    def __init__(self) -> None:
        self.text = ""

    def take(self, line: bytes) -> None:
        """Keep the reason in a line of the log."""
        reason = trouble_in(line)
        if reason is not None:
            self.text = f": {reason}"
