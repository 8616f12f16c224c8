"""A process of the testbed: its command line, its children, its signals, and the guard of its exit code."""

import atexit
import os
import re
import select
import shlex
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence, Set
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

import tis
from tis.common.errors import EXIT_BUG, EXIT_INTERRUPTED, DataError, Fault, TisError

_ZENOH_SETTING: Final = "--cfg"
_LEFT_OUT: Final = "..."
_SECRET_OF_AN_ENDPOINT: Final = re.compile(r"(\w*(?:private_key|password|secret|token)\w*=)[^;]*")


def command_line(words: Sequence[str] | None = None) -> str:
    """Return the command as it was typed, ``words`` or else this process's, with ``...`` in place of secrets.

    Left out are the value of each ``--cfg``, as a setting of Zenoh may hold a password, and keys in an endpoint.
    Oracle: literals, test_process.
    """
    return shlex.join(["tis", *_without_secrets(sys.argv[1:] if words is None else words)])


def _without_secrets(words: Sequence[str]) -> Iterator[str]:
    is_setting = False
    for word in words:
        if is_setting:
            yield _setting(word)
        elif word.startswith(f"{_ZENOH_SETTING}="):
            yield f"{_ZENOH_SETTING}={_setting(word.removeprefix(f'{_ZENOH_SETTING}='))}"
        else:
            yield _SECRET_OF_AN_ENDPOINT.sub(rf"\g<1>{_LEFT_OUT}", word) if "#" in word else word
        is_setting = word == _ZENOH_SETTING and not is_setting


_RUN_DIR: Final = re.compile(r""" ('--run-dir=[^']*'|--run-dir[= ]('[^']*'|"[^"]*"|[^\s'"])+)""")


def repeatable(command: str, instead: str = "") -> str:
    """Return a command line with ``instead`` of ``--run-dir``, whose folder holds the run by now.

    Oracle: literals, test_process.
    """
    return _RUN_DIR.sub(instead, command)


def _setting(text: str) -> str:
    """Return ``KEY:VALUE`` without its value."""
    key, colon, _ = text.partition(":")
    return f"{key}:{_LEFT_OUT}" if colon else _LEFT_OUT


PACKAGES: Final = str(Path(tis.__file__).parents[1])
"""The folder that holds the package ``tis``."""


def child_environment() -> dict[str, str]:
    """Return this process's environment, in which ``python -m`` does not put the current folder on the path.

    A module there that has the name of one of ours or of a library would replace it. The testbed's own folder is not
    put on the path either: in a checkout it holds packages of common names. Oracle:
    `tests/common/runtime/test_process`, children in folders with packages of those names.

    A child that crashes within a library prints where. One of ours ends with this process (`follow_parent`).
    """
    parent = f"{os.getpid()}:{_begin_of(os.getpid())}"
    return {**os.environ, "PYTHONSAFEPATH": "1", "PYTHONFAULTHANDLER": "1", _PARENT: parent}


_PARENT: Final = "TIS_PARENT"
_GLANCE_S: Final = 0.5


def end_by_input(process: "subprocess.Popen[Any]", grace_s: float) -> None:
    """End a process that runs until its standard input is closed; it is killed where it does not within this time."""
    assert process.stdin is not None
    with suppress(OSError):  # it has ended
        process.stdin.close()
    try:
        process.wait(grace_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def follow_parent() -> None:
    """Let this process end, as by SIGTERM, with the one that started it by `child_environment`, killed or not.

    The kernel's own means, PR_SET_PDEATHSIG, tells of the end of the *thread* that started it. A process that has
    taken the number of the dead parent is told from it by the time of its begin.
    """
    pid, _, begin = os.environ.pop(_PARENT, "").partition(":")  # popped: the next child has another parent
    if pid.isdecimal() and begin:
        threading.Thread(target=_end_after, args=(int(pid), begin), name="parent", daemon=True).start()


def _end_after(pid: int, begin: str) -> None:
    try:
        process = os.pidfd_open(pid)
    except ProcessLookupError:
        process = None
    except OSError:  # a container may forbid it
        while _begin_of(pid) == begin:
            time.sleep(_GLANCE_S)
        process = None
    if process is not None and _begin_of(pid) == begin:  # it cannot become another one from here on
        select.select((process,), (), ())
    os.kill(os.getpid(), signal.SIGTERM)


def _begin_of(pid: int) -> str:
    """Return when a process began, in the kernel's ticks; empty when it is over."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(errors="replace").rpartition(")")[2].split()
    except OSError:
        return ""
    return fields[19] if fields[0] not in "ZX" else ""


_ENDING: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_STANDARD_STREAMS: Final = (0, 1, 2)


class Interrupt:
    """SIGINT, SIGTERM and SIGHUP as a flag; ``wakers`` wake the waiting loops.

    SIGHUP, sent when a terminal or its ssh session ends, stays ignored where it is ignored already (``nohup``).
    SIGINT does not: a shell script starts what it puts in the background with SIGINT ignored.
    """

    def __init__(self) -> None:
        self.requested = False
        self.wakers: list[Callable[[], None]] = []
        self._hung_up = False
        self._terminals: set[int] = set()

    @contextmanager
    def installed(self) -> Iterator[None]:
        """Handle the signals within the block."""
        is_nohup = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
        self._terminals = {os.fstat(number).st_rdev for number in _STANDARD_STREAMS if os.isatty(number)}
        handled = [number for number in _ENDING if not (is_nohup and number == signal.SIGHUP)]
        before = {number: signal.signal(number, self._note) for number in handled}
        try:
            yield
        finally:
            if self._hung_up:  # shell and kernel send one SIGHUP each; the second must not stop the clean-up
                before[signal.SIGHUP] = signal.SIG_IGN
            for number, handler in before.items():
                signal.signal(number, handler)

    def _note(self, number: int, frame: Any) -> None:  # noqa: ARG002
        if number == signal.SIGHUP:
            self._hung_up = True
            _detach_from(self._terminals)
        self.requested = True
        for wake in self.wakers:
            wake()


def _detach_from(terminals: Set[int]) -> None:
    """Redirect each descriptor of a lost terminal to the null device, since each write would fail.

    Standard output may have a copy: `tis.common.runtime.zenoh_log` puts a pipe in its place.
    """
    null = os.open(os.devnull, os.O_RDWR)
    for number in [int(path.name) for path in Path("/dev/fd").iterdir()]:
        with suppress(OSError):
            if os.fstat(number).st_rdev in terminals and not os.isatty(number):
                os.dup2(null, number)
    os.close(null)


def guarded_exit_code(name: str, run: Callable[[], int], failed: Callable[[int, Sequence[Fault]], None]) -> int:
    """Return the exit code of ``run``, which reports no error of its own.

    Parameters
    ----------
    name
        The command; it stands in place of a file where an error of the system names none.
    run
        The command's work; returns its exit code.
    failed
        Reports the exit code and the faults. A bug's traceback is on standard error before.

    Raises
    ------
    BrokenPipeError
        When the reader of standard output has gone away, as `head` does: typer ends silently with exit code 1.
    """
    try:
        code = run()
        sys.stdout.flush()  # now, while a reader that went away can be told from a full disk
        return code
    except TisError as error:
        code, faults = error.exit_code, list(error.faults)
    except OSError as error:
        if isinstance(error, BrokenPipeError) and _reader_is_gone():
            raise
        code, faults = DataError.exit_code, [Fault(str(error.filename or name), "", error.strerror or str(error))]
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except Exception as error:
        traceback.print_exc()
        code, faults = EXIT_BUG, [Fault(name, "", f"bug: {type(error).__name__}: {error}")]
    failed(code, faults)
    return code


def line_of(name: str, fault: Fault) -> str:
    """Return the line that reports ``fault``, which begins with the command's name."""
    return str(fault) if fault.where == name else f"{name}: {fault}"


def _reader_is_gone() -> bool:
    """Tell whether standard output is a pipe without a reader."""
    with suppress(OSError, ValueError):  # an output that is no file
        poll = select.poll()
        poll.register(sys.stdout.fileno(), 0)
        return any(event & select.POLLERR for _, event in poll.poll(0))
    return False


def run_to_end(main: Callable[[], object]) -> None:
    """Run ``main`` and end the process with its exit code; once Zenoh was loaded, without finalising the interpreter.

    A process that one of ours started ends with that one.

    Zenoh's threads outlive its sessions. One that still wants the interpreter, or runs through the exit handlers of
    the C library, aborts the whole process: `tis run` ended with SIGABRT instead of its exit code, rarely and on a
    busy machine only. Threads of ours are joined, exit handlers called and outputs flushed before.
    """
    follow_parent()
    try:
        main()
        code = 0
    except SystemExit as ended:
        if "zenoh" not in sys.modules:
            raise
        code = _number(ended.code)
    if "zenoh" not in sys.modules:
        return
    # what the interpreter calls, in its order: pools of threads are told to end before threads are joined
    threading._shutdown()  # type: ignore[attr-defined]
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # a reader that has gone away
            stream.flush()
    os._exit(code)


def _number(code: object) -> int:
    if code is None:
        return 0
    if isinstance(code, int):
        return code & 0xFF
    sys.stderr.write(f"{code}\n")
    return 1
