"""The queryables of a network: listed by a child process, and told apart by their owners.

The child process is replaced when it falls silent; `tis.netem.bridge.mirrors.lister` explains why it is a process.
The last list stays valid until the next one arrives.

A router declares the keys of queryables to a client, but not their owners: netem with its mirrors, or applications.
The matching status of the queriers of netem's own session adds whether others answer a key, and whether one of them
is complete (`owned_by_others`).
"""

import contextlib
import json
import os
import select
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from typing import Final, Protocol

import zenoh

from tis.common.runtime.process import child_environment
from tis.netem.bridge.mirrors.lister import Settings

_TIMEOUT_S: Final = 1.5
_FIRST_TIMEOUT_S: Final = 3.0
_PAUSE_S: Final = 0.1
_MAX_PAUSE_S: Final = 2.0
_SILENCE_S: Final = 3.0
_MAX_BYTES: Final = 1 << 16
_CHUNK: Final = "4f1c-netem-sample"
_DEPTH: Final = 5


class Listing:
    """The list of one network; ``config`` is that of a client of its router, which reads its own admin space.

    Listed queryables overlap one of ``within``. ``proof`` is the key of a queryable that the caller has declared: a
    list without it is incomplete, since access control may hide queryables. ``on_silence`` is called from a thread
    that waits for no router, after ``silence_s`` without a list and until it returns True: the silence is real, not
    that of a busy machine. ``on_return`` is called when a list arrives after that. Both get the silence in s.
    """

    def __init__(
        self,
        config: zenoh.Config,
        within: Sequence[str],
        proof: str,
        on_silence: Callable[[float], bool],
        on_return: Callable[[float], None],
        silence_s: float = _SILENCE_S,
    ) -> None:
        self.n_started = 0
        self._settings = json.dumps(Settings(str(config), (*within, proof))._asdict()).encode() + b"\n"
        self._proof = proof
        self._on_silence = on_silence
        self._on_return = on_return
        self._is_silent = False
        self._silence_s = silence_s
        self._keys: frozenset[str] | None = None
        self._heard_s = time.monotonic()
        self._first = threading.Event()
        self._over = threading.Event()
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._thread = threading.Thread(target=self._supervise, name="listing", daemon=True)
        self._thread.start()

    @property
    def keys(self) -> frozenset[str] | None:
        """Return the key expressions of the network's queryables; None before the first list."""
        return self._keys

    def await_first(self, timeout_s: float) -> bool:
        """Wait for the first list; False after ``timeout_s``."""
        return self._first.wait(timeout_s)

    def close(self) -> None:
        """End the child; a second call does nothing."""
        with self._lock:
            self._over.set()
            if self._process is not None:
                self._process.kill()
        self._thread.join()

    def _supervise(self) -> None:
        pause_s = _PAUSE_S
        while not self._over.is_set():
            before_s = self._heard_s
            self._follow_a_child()
            silent_s = time.monotonic() - self._heard_s
            pause_s = _PAUSE_S if self._heard_s > before_s else min(2 * pause_s, _MAX_PAUSE_S)
            is_long = silent_s > self._silence_s and self._keys is not None
            if is_long and not self._is_silent and not self._over.is_set():
                self._is_silent = self._on_silence(silent_s)
            self._over.wait(pause_s)

    def _follow_a_child(self) -> None:
        """Start a child process and read its lists until it ends or falls silent."""
        with self._lock:
            if self._over.is_set():
                return
            self._process = process = _start()
            self.n_started += 1
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            process.stdin.write(self._settings)
            process.stdin.flush()
            known = False
            for line in _lines(process.stdout.fileno()):
                known = self._take(line) if line else known
                if known:
                    silent_s, self._heard_s = time.monotonic() - self._heard_s, time.monotonic()
                    if self._is_silent:
                        self._is_silent = False
                        self._on_return(silent_s)
                    self._first.set()
        except (OSError, ValueError):  # it has ended, or its output is invalid
            pass
        finally:
            with self._lock:
                process.kill()
                self._process = None
            process.stdout.close()
            with contextlib.suppress(OSError):
                process.stdin.close()
            process.wait()

    def _take(self, line: bytes) -> bool:
        """Keep a list; False if it is incomplete."""
        keys = frozenset(json.loads(line))
        if self._proof not in keys:
            return False
        self._keys = keys - {self._proof}
        return True


def _start() -> "subprocess.Popen[bytes]":
    return subprocess.Popen(
        [sys.executable, "-m", "tis.netem.bridge.mirrors.lister"],
        stdin=subprocess.PIPE,  # closed when this process ends, which ends the child
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        bufsize=0,
        start_new_session=True,  # Ctrl-C must reach only this process
        env=child_environment(),
    )


def _lines(pipe: int) -> Iterator[bytes]:
    """Yield lines until the pipe ends, or until a timeout without a line."""
    rest, timeout_s = b"", _FIRST_TIMEOUT_S
    while select.select((pipe,), (), (), timeout_s)[0]:
        chunk = os.read(pipe, _MAX_BYTES)
        if not chunk:
            return
        *lines, rest = (rest + chunk).split(b"\n")
        if lines:
            timeout_s = _TIMEOUT_S
        yield from lines


class Listed(Protocol):
    """A queryable that a network lists."""

    @property
    def expr(self) -> zenoh.KeyExpr:
        """Its key expression."""

    @property
    def is_answered(self) -> bool:
        """Whether others than netem answer its `sample`."""

    @property
    def is_complete(self) -> bool:
        """Whether others than netem have a complete queryable that includes it."""


def sample(expr: zenoh.KeyExpr) -> zenoh.KeyExpr:
    """Return a key that only an expression, and those that include it, are likely to match."""
    deep = "/".join([_CHUNK] * _DEPTH)
    chunks = (deep if c == "**" else c.replace("$*", _CHUNK).replace("*", _CHUNK) for c in str(expr).split("/"))
    return zenoh.KeyExpr("/".join(chunks))


def owned_by_others(listed: Mapping[str, Listed], own: Container[str]) -> set[str]:
    """Return the keys of queryables of others; ``own`` are the keys of netem's queryables in that network.

    If netem has the same expression, others have it too when they answer its sample and no wider listed queryable of
    theirs explains the answer. One that is explained counts only if it is complete and the wider one is not.
    """
    answered = [key for key, one in listed.items() if one.is_answered]
    found = {key for key in answered if key not in own}
    doubtful = [key for key in answered if key in own]
    width = {key: sum(listed[key].expr.includes(listed[other].expr) for other in doubtful) for key in doubtful}
    for key in sorted(doubtful, key=lambda key: (-width[key], key)):
        one, probe = listed[key], sample(listed[key].expr)
        wider = [listed[other] for other in found if listed[other].expr.includes(probe)]
        if not wider or (one.is_complete and not any(other.is_complete for other in wider)):
            found.add(key)
    return found
