"""A deadlocked session is told from one that works. The ending is that of a process: see `tis netem`."""

import subprocess
import sys
import threading
from types import SimpleNamespace
from typing import Any, cast

import pytest
import zenoh

from tests.common.runtime.live_zenoh import a_network
from tis.common.errors import PeerError
from tis.netem.bridge.standstill import is_deadlocked

pytestmark = pytest.mark.live

_ENDING = """
import threading
from tis.netem.bridge.standstill import end_process, router_deadlock
class Bridge:
    def failed(self, error):
        print("ended", flush=True)
end_process(Bridge(), router_deadlock("west"), print)
threading.Event().wait()  # as a session does whose close hangs
"""


class Locked:
    """A session whose declarations wait for a lock that is never free."""

    def __init__(self) -> None:
        self.free = threading.Event()

    def declare_querier(self, _: str) -> Any:
        self.free.wait()
        return SimpleNamespace(undeclare=lambda: None)


def test_a_session_that_cannot_declare_stands_still() -> None:
    locked = Locked()
    assert is_deadlocked(cast("zenoh.Session", locked), 0.1)
    locked.free.set()


def test_one_that_can_does_not() -> None:
    with a_network() as network:
        assert not is_deadlocked(network.router)
        assert not is_deadlocked(network.client)


def test_a_process_that_cannot_close_ends_with_a_reason_and_a_code() -> None:
    done = subprocess.run([sys.executable, "-c", _ENDING], capture_output=True, text=True, timeout=120)
    assert done.returncode == PeerError.exit_code
    assert "the west network: netem's own session is deadlocked" in done.stdout
    assert "ended" in done.stdout
