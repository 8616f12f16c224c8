"""The observer on networks that not everybody may enter."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from itertools import chain, repeat
from pathlib import Path
from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.common.runtime.live_zenoh import a_router, soon
from tis.common.channels import Network
from tis.common.clocks import Exchanges
from tis.common.runtime.clock_watch import ClockServer
from tis.common.runtime.control import ControlKeys
from tis.common.runtime.ports import free_endpoints
from tis.common.runtime.zenoh_session import ZenohOptions, configure, open_router
from tis.common.units import NS_PER_S
from tis.deploy.view.server import ViewOptions
from tis.deploy.watch.observer import Observer, ObserverPath, Vantage, heard_until_ns, observer_path, vantage


def _is_there(observer: Observer) -> bool:
    return observer.attendance().connected


@pytest.mark.live
def test_zenoh_s_own_options_let_the_page_in(tmp_path: Path) -> None:
    users = tmp_path / "users.txt"
    users.write_text("lab:secret")
    west, east = free_endpoints()
    asks = (f"transport/auth/usrpwd/dictionary_file:'{users}'",)
    says = ("transport/auth/usrpwd/user:'lab'", "transport/auth/usrpwd/password:'secret'")
    with (
        open_router(configure("router", ZenohOptions(listen=[west], cfg=asks)), west),
        open_router(configure("router", ZenohOptions(listen=[east], cfg=asks)), east),
    ):
        for cfg, comes_in in ((says, True), (("transport/auth/usrpwd/user:'eve'",), False)):
            options = ViewOptions(west, east, cfg=cfg)
            observer = Observer({"west": options.west, "east": options.east}, "tis", zenoh=options.zenoh)
            observer.start()
            try:
                if comes_in:
                    assert soon(partial(_is_there, observer))
            finally:
                observer.stop()
            assert observer.attendance().connected == comes_in
            assert observer.error is None


BOTH: Final[tuple[Network, ...]] = ("west", "east")


def test_a_packet_is_not_lost_before_the_later_network_was_heard() -> None:
    """East is heard 2 s late, as by a thread that got no processor: what came there meanwhile is not known yet."""
    now_ns = 100 * NS_PER_S
    assert heard_until_ns(now_ns, {"west": now_ns - 1, "east": 98 * NS_PER_S}, BOTH) == 98 * NS_PER_S


def test_a_network_that_is_silent_for_long_holds_nothing_up() -> None:
    now_ns = 100 * NS_PER_S
    assert heard_until_ns(now_ns, {"west": now_ns - 1}, BOTH) == 97 * NS_PER_S
    assert heard_until_ns(now_ns, {}, BOTH) == 97 * NS_PER_S


def test_it_never_lies_ahead() -> None:
    assert heard_until_ns(5, {"west": 9, "east": 8}, BOTH) == 5


AHEAD_NS = 7_000_000_000
LEGS = st.lists(st.tuples(st.integers(0, 10**8), st.integers(0, 10**8)), min_size=1, max_size=20)


def _exchanges(legs: list[tuple[int, int]]) -> Exchanges:
    """Exchanges whose ways there and back are known, with a clock that is ahead."""
    stamps = []
    for i, (there_ns, back_ns) in enumerate(legs):
        asked_ns = i * 10**9
        received_ns = asked_ns + there_ns + AHEAD_NS
        stamps.append((asked_ns, received_ns, received_ns + 5, asked_ns + there_ns + 5 + back_ns))
    return Exchanges.of(stamps)


def test_half_the_shortest_round_trip_and_what_the_longest_leaves_open() -> None:
    assert observer_path(_exchanges([(3_000_000, 5_000_000), (2_000_000, 4_000_000)])) == ObserverPath(
        3_000_000, 5_000_000
    )
    assert observer_path(_exchanges([(4_000_000, 4_000_000)])) == ObserverPath(4_000_000, 4_000_000)
    with pytest.raises(ValueError):
        observer_path(_exchanges([]))


@given(LEGS, LEGS, st.integers(0, 10**9))
def test_a_corrected_delay_is_off_by_no_more_than_is_said(
    west: list[tuple[int, int]], east: list[tuple[int, int]], delay_ns: int
) -> None:
    one, other = observer_path(_exchanges(west)), observer_path(_exchanges(east))
    bound_ms = vantage([one, other], False).bound_ms
    for _, to_west_ns in west:
        for _, to_east_ns in east:  # a message that took the very ways that the answers took
            seen_ns = (delay_ns + to_east_ns - other.ns) - (to_west_ns - one.ns)
            assert abs(seen_ns - delay_ns) <= bound_ms * 1e6 + 1e-3


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


@pytest.mark.live
def test_on_netems_host_there_is_no_way_to_take_off() -> None:
    with an_observer() as observer:
        assert soon(lambda: observer.vantage() is not None)
        assert observer.vantage() == Vantage(here=True, bound_ms=0)
    assert observer.error is None


@pytest.mark.live
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
