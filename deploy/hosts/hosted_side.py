"""A side on this host: it lives as long as the connection that started it, and its end is told."""

import contextlib
import os
import queue
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any, Final

from tis.common.errors import EXIT_OK, DataError, Fault, file_faults
from tis.common.runtime.process import Interrupt, child_environment
from tis.deploy.hosts.protocol import INTERRUPT, MAX_LINE_BYTES, MAX_SILENCE_S, RunRequest, line_of
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.launch import MODULES

_POLL_S: Final = 0.1
GRACE_S: Final = 5.0
"""Between the request to end and SIGKILL: a log is closed within it."""
_MAX_WAITING_LINES: Final = 2000
_RUNNING: Final = b'"event": "running"'


def run_side(request: RunRequest, run_dir: Path, lifeline: int, out: int) -> int:
    """Run a side to its end; raises `DataError` before it starts.

    Parameters
    ----------
    request
        The side and its scenario.
    run_dir
        Folder of the log; made here, and removed again if the run never began.
    lifeline
        File descriptor of the connection: its end, a silence of `MAX_SILENCE_S` or the line `INTERRUPT` ends the
        side.
    out
        File descriptor for the side's events, and for the last one, ``exit`` with the exit code.
    """
    is_new = _prepare(run_dir, request.scenario)
    interrupt = Interrupt()
    with interrupt.installed():
        talk = _Talk(out)
        process = _start(request, run_dir)
        readers = [_forwarding(process.stdout, talk.pass_on), _forwarding(process.stderr, talk.tell_output)]
        watch = _Lifeline(lifeline)
        signalled_s: float | None = None
        while process.poll() is None:
            if signalled_s is None and (interrupt.requested or watch.is_over(_POLL_S) or talk.is_broken):
                signalled_s = time.monotonic()
                process.send_signal(signal.SIGINT)
            elif signalled_s is not None:
                time.sleep(_POLL_S)
                if time.monotonic() > signalled_s + GRACE_S:
                    process.kill()
        for reader in readers:
            reader.join(GRACE_S)  # a process that the side started may keep the pipe open
        talk.tell({"event": "exit", "code": process.returncode})
        talk.close()
    if is_new and not talk.has_begun:
        _remove_unused(run_dir, request.side)
    return EXIT_OK


def _prepare(run_dir: Path, scenario: str) -> bool:
    """Make the run's folder with its scenario; tell whether it is new. Raises `DataError`."""
    file = run_dir / folder.SCENARIO_FILE
    is_new = not run_dir.exists()
    with file_faults(run_dir, "run folder cannot be created"):
        run_dir.mkdir(parents=True, exist_ok=True)
    if is_new:
        folder.write(file, scenario)
    elif not file.is_file() or file.read_text() != scenario:
        raise DataError(Fault(str(run_dir), "", "is the folder of another run"))
    return is_new


def _start(request: RunRequest, run_dir: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", MODULES[request.side], str(run_dir / folder.SCENARIO_FILE)]
    command += ["--child", "--alone", "--run-dir", str(run_dir), "--wait-s", str(request.wait_s)]
    command += ["--insecure"] if request.insecure else []
    return subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
        env=child_environment(),
    )  # fmt: skip


def _forwarding(pipe: IO[bytes] | None, take: Callable[[bytes], None]) -> threading.Thread:
    """Start a thread that passes on the lines of a pipe, and closes it."""
    assert pipe is not None

    def forward() -> None:
        with pipe:
            while line := pipe.readline(MAX_LINE_BYTES):
                take(line)

    thread = threading.Thread(target=forward, daemon=True)
    thread.start()
    return thread


class _Talk:
    """Lines to `tis up`, from a thread of their own: a connection that stands still must not stop the side."""

    def __init__(self, out: int) -> None:
        self.is_broken = False
        self.has_begun = False
        self._out = out
        self._waiting: queue.Queue[bytes | None] = queue.Queue(_MAX_WAITING_LINES)
        self._thread = threading.Thread(target=self._write, daemon=True)
        self._thread.start()

    def pass_on(self, line: bytes) -> None:
        self.has_begun = self.has_begun or _RUNNING in line
        with contextlib.suppress(queue.Full):
            self._waiting.put_nowait(line)

    def tell(self, event: dict[str, Any]) -> None:
        self.pass_on(line_of(event))

    def tell_output(self, line: bytes) -> None:
        self.tell({"event": "output", "text": line.decode("utf-8", "replace").rstrip()})

    def close(self) -> None:
        """Wait until all is written, for a while."""
        with contextlib.suppress(queue.Full):
            self._waiting.put(None, timeout=GRACE_S)
        self._thread.join(GRACE_S)

    def _write(self) -> None:
        while (line := self._waiting.get()) is not None:
            try:
                while line:
                    line = line[os.write(self._out, line) :]
            except OSError:
                self.is_broken = True
                return


class _Lifeline:
    """The connection to `tis up`, as seen from the host."""

    def __init__(self, number: int) -> None:
        self._number = number
        self._heard_s = time.monotonic()
        self._over = False

    def is_over(self, wait_s: float) -> bool:
        """Wait for a line, at most ``wait_s``; tell whether the side has to end."""
        if self._over:
            return True
        if select.select([self._number], [], [], wait_s)[0]:
            said = os.read(self._number, MAX_LINE_BYTES)
            self._heard_s = time.monotonic()
            self._over = not said or INTERRUPT.encode() in said
        elif time.monotonic() > self._heard_s + MAX_SILENCE_S:
            self._over = True
        return self._over


def _remove_unused(run_dir: Path, side: str) -> None:
    with contextlib.suppress(OSError):
        for name in (folder.SCENARIO_FILE, f"{side}.mcap"):
            (run_dir / name).unlink(missing_ok=True)
        run_dir.rmdir()
