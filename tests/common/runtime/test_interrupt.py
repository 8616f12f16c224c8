"""Signals that end a side in order."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest

from tis.common.runtime.process import Interrupt

_WORDS = """
import os, signal, sys
from tis.common.runtime.process import Interrupt
interrupt = Interrupt()
with interrupt.installed():
    os.kill(os.getpid(), signal.SIGHUP)
os.kill(os.getpid(), signal.SIGHUP)
print(interrupt.requested)
"""


@pytest.fixture(autouse=True)
def no_nohup() -> Iterator[None]:
    """Let SIGHUP end a process as usual, also where `nohup` has started the tests."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_is_a_flag_and_wakes_who_waits(number: signal.Signals) -> None:
    interrupt, woken = Interrupt(), []
    interrupt.wakers.append(lambda: woken.append(number))
    before = signal.getsignal(number)
    with interrupt.installed():
        assert not interrupt.requested
        os.kill(os.getpid(), number)
        assert interrupt.requested
    after = signal.signal(number, before)
    assert woken == [number]
    assert after == (signal.SIG_IGN if number == signal.SIGHUP else before)


@pytest.mark.parametrize(("head", "requested"), [([], "True"), (["nohup"], "False")])
def test_a_second_hangup_ends_nothing_and_nohup_ignores_all(head: list[str], requested: str) -> None:
    done = subprocess.run(
        [*head, sys.executable, "-c", _WORDS], stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout.strip()) == (0, requested), done.stderr
