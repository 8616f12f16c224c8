"""From where an observer sees a run: by real exchanges with netem's clock on loopback."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from itertools import chain, repeat

import pytest

from tests.common.runtime.live_zenoh import a_router, soon
from tis.common.runtime.clock_watch import ClockServer
from tis.common.runtime.control import ControlKeys
from tis.common.runtime.process import free_endpoints
from tis.deploy.watch.observer import Observer, Vantage

pytestmark = pytest.mark.live


@contextmanager
def an_observer() -> Iterator[Observer]:
    """An observer of two networks whose reference clock netem would serve."""
    west, east = free_endpoints()
    with ExitStack() as stack:
        routers = [stack.enter_context(a_router(endpoint)) for endpoint in (west, east)]
        stack.enter_context(ClockServer(routers, ControlKeys("t").clock))
        observer = Observer({"west": west, "east": east}, "t")
        observer.start()
        stack.callback(observer.stop)
        yield observer


def test_on_netems_host_there_is_no_way_to_take_off() -> None:
    with an_observer() as observer:
        assert soon(lambda: observer.vantage() is not None)
        assert observer.vantage() == Vantage(here=True, bound_ms=0)
    assert observer.error is None


def test_on_another_host_the_ways_are_measured_and_said_to_be_uncertain(monkeypatch: pytest.MonkeyPatch) -> None:
    boots = chain(["the server's"], repeat("the observer's"))
    monkeypatch.setattr("tis.common.runtime.clock_watch.boot_id", lambda: next(boots))
    with an_observer() as observer:
        assert soon(lambda: observer.vantage() is not None)
        found = observer.vantage()
        assert found is not None
        assert not found.here
        assert 0 < found.bound_ms < 1000
    assert observer.error is None
