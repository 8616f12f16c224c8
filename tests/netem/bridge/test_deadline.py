"""A process ends after a signal although its main thread, or its closing, waits for ever outside Python."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tis.common.errors import PeerError
from tis.common.runtime.ports import free_endpoints

pytestmark = pytest.mark.live

# a lock taken twice: unlike a sleep it is not ended by a signal, and no handler in Python runs meanwhile
_STUCK = """
import ctypes, signal, sys, time
from tis.common.runtime.process import Interrupt
from tis.netem.bridge.standstill import Deadline
libc, lock = ctypes.CDLL(None), ctypes.create_string_buffer(64)
def stick():
    libc.pthread_mutex_lock(lock)
    libc.pthread_mutex_lock(lock)
"""
_MAIN = """
deadline = Deadline(print, patience_s=0.3)
with Interrupt().installed(), deadline.installed():
    {}
    print("ready", flush=True)
    stick()
"""
_CLOSING = """
from tis.netem.bridge.applications import Applications
from tis.netem.__main__ import command
import typer
Applications.close = lambda self: stick()
typer.run(command)
"""


def ended(code: str, *arguments: str, stop: bool = True) -> tuple[int, str]:
    """Run a program, stop it once it says that it is ready, and return its exit code and what it said."""
    program = [sys.executable, "-c", _STUCK + code, *arguments]
    root = Path(__file__).parents[3]
    with subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=root) as process:
        assert process.stdout is not None
        said = ""
        for line in process.stdout:
            said += line
            if stop and ("ready" in line or "running" in line):
                process.send_signal(signal.SIGTERM)
                stop = False
        return process.wait(60), said


def test_a_signal_ends_a_process_whose_main_thread_is_stuck() -> None:
    code, said = ended(_MAIN.format(""))
    assert code == PeerError.exit_code
    assert "does not end within 0.3 s, because a call to Zenoh does not return" in said


def test_closing_that_never_ends_is_ended_without_a_signal() -> None:
    code, _ = ended(_MAIN.format("deadline.begin()"), stop=False)
    assert code == PeerError.exit_code


def test_a_log_that_grows_is_completed() -> None:
    grows = "deadline.progress = lambda n=[0]: n.__setitem__(0, n[0] + 1) or n[0]; deadline.begin(); time.sleep(1.5)"
    code, said = ended(_MAIN.format(grows + "; sys.exit(0)"), stop=False)
    assert (code, said) == (0, "")


def test_netem_ends_after_a_signal_although_it_cannot_close() -> None:
    west, east = free_endpoints()
    code, said = ended(_CLOSING, "--west", west, "--east", east)
    assert code == PeerError.exit_code
    assert "a call to Zenoh does not return: the process ends without closing its sessions" in said
