"""Queryables are found whatever becomes of the process that lists them, and without any router's admin space."""

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import zenoh

from tests.common.runtime.live_zenoh import a_client, a_router, soon
from tests.netem.bridge.live_bridge import Bridged, a_bridge, bridging, n_mirrored, two_routers
from tests.netem.bridge.mirrors.test_queries import a_queryable, ask
from tis.common.channels import Network
from tis.common.runtime.ports import free_endpoints
from tis.common.runtime.zenoh_session import ZenohOptions
from tis.netem.bridge.mirrors.listing import Listing
from tis.netem.bridge.sides import lister_config

pytestmark = pytest.mark.live


def leave(query: zenoh.Query) -> None:
    query.drop()  # type: ignore[no-untyped-call]


@contextmanager
def churning(endpoint: str) -> Iterator[threading.Event]:
    """Let two clients come, declare 20 queryables and go; the event is set once they have done so often."""
    over, often = threading.Event(), threading.Event()

    def churn(name: str) -> None:
        n = 0
        while not over.is_set():
            with a_client(endpoint) as client:
                for i in range(20):
                    client.declare_queryable(f"churn/{name}/{i}", leave)
            n += 1
            if n == 150:
                often.set()

    threads = [threading.Thread(target=churn, args=(name,)) for name in "ab"]
    for thread in threads:
        thread.start()
    try:
        yield often
    finally:
        over.set()
        for thread in threads:
            thread.join()


def listings(there: Bridged) -> list[Listing]:
    by_direction = there.applications.queryables._listings
    return [by_direction[direction] for direction in ("forward", "feedback") if direction in by_direction]


def test_more_are_listed_than_a_channel_of_zenoh_s_holds() -> None:
    with a_bridge() as there:
        held = [there.east.declare_queryable(f"demo/{i}", leave) for i in range(300)]
        assert soon(lambda: n_mirrored(there) == 300)
        for one in held:
            one.undeclare()  # type: ignore[no-untyped-call]
        assert soon(lambda: n_mirrored(there) == 0)


def test_one_expression_on_both_networks_is_mirrored_on_both_until_it_goes() -> None:
    with a_bridge() as there:
        with a_queryable(there.west, "demo/a") as asked_west, a_queryable(there.east, "demo/a") as asked_east:
            assert soon(lambda: n_mirrored(there) == 2)
            assert len(ask(there.west, "demo/a?silence", target=zenoh.QueryTarget.ALL)) == 0
            assert (len(asked_west), len(asked_east)) == (1, 1)
        assert soon(lambda: n_mirrored(there) == 0)


def test_declarations_without_end_stop_neither_router_nor_listing() -> None:
    """What stopped both routers within seconds when their admin space was read."""
    with a_bridge() as there, churning(there.endpoints["east"]) as often:
        assert often.wait(10.0)
        with a_queryable(there.east, "demo/a"):
            assert soon(lambda: len(ask(there.west, "demo/a")) == 1)
        heard: list[zenoh.Sample] = []
        with there.east.declare_subscriber("demo/b", heard.append):
            assert soon(lambda: bool(there.west.put("demo/b", b"1") or heard))


@pytest.mark.parametrize("signal_number", [signal.SIGSTOP, signal.SIGKILL])
def test_a_process_that_falls_silent_is_replaced_and_nothing_is_forgotten(signal_number: signal.Signals) -> None:
    with a_bridge() as there, a_queryable(there.east, "demo/a"):
        assert soon(lambda: n_mirrored(there) == 1)
        for listing in listings(there):
            assert listing._process is not None
            os.kill(listing._process.pid, signal_number)
        with a_queryable(there.east, "demo/b"):
            assert soon(lambda: n_mirrored(there) == 2) or soon(lambda: n_mirrored(there) == 2)
        assert [listing.n_started for listing in listings(there)] == [2, 2]
        assert soon(lambda: n_mirrored(there) == 1)
        assert there.leaks == []
    assert listings(there) == []


def test_a_network_that_tells_nothing_has_one_stand_for_all() -> None:
    with two_routers() as (sessions, endpoints):
        nowhere: dict[Network, str] = {"west": endpoints["west"], "east": "tcp/127.0.0.1:1"}
        with bridging(sessions, endpoints, probes=False, ways=nowhere) as there, a_queryable(there.east, "demo/**"):
            assert len(there.leaks) == 1
            assert "the east network does not list its queryables" in there.leaks[0]
            assert len(ask(there.west, "demo/a")) == 1
            assert n_mirrored(there) == 0


def test_what_lacks_the_proof_was_told_by_nobody_who_knows() -> None:
    endpoint, _ = free_endpoints()
    with a_router(endpoint), a_client(endpoint) as client, a_queryable(client, "demo/a"):
        config = lister_config(ZenohOptions(connect=[endpoint]))
        listing = Listing(config, ["**"], "demo/proof", lambda _: True, lambda _: None)
        try:
            assert not listing.await_first(0.7)
            assert listing.keys is None
            with a_queryable(client, "demo/proof"):
                assert listing.await_first(5.0)
                assert listing.keys == {"demo/a"}
        finally:
            listing.close()


def test_a_router_that_is_gone_is_told_of_once_and_so_is_its_return() -> None:
    endpoint, _ = free_endpoints()
    silences: list[float] = []
    returns: list[float] = []

    def is_real(silent_s: float) -> bool:
        silences.append(silent_s)
        return True

    with a_router(endpoint) as router, a_queryable(router, "demo/a"):
        config = lister_config(ZenohOptions(connect=[endpoint]))
        listing = Listing(config, ["**"], "demo/a", is_real, returns.append, silence_s=0.2)
        assert listing.await_first(5.0)
    try:
        assert soon(lambda: len(silences) == 1)
        n_started = listing.n_started
        assert soon(lambda: listing.n_started > n_started + 1)
        assert len(silences) == 1
        assert silences[0] > 0.2
        assert listing.keys == frozenset()  # what was there is kept
        assert returns == []
        with a_router(endpoint) as router, a_queryable(router, "demo/a"), a_queryable(router, "demo/b"):
            assert soon(lambda: len(returns) == 1)
            assert returns[0] > silences[0]
            assert soon(lambda: listing.keys == frozenset(["demo/b"]))
        assert soon(lambda: len(silences) == 2)
    finally:
        listing.close()


def test_a_silence_that_is_not_real_is_told_of_when_it_becomes_real() -> None:
    """A busy machine may stop the process that lists for seconds, while the router answers."""
    endpoint, _ = free_endpoints()
    asked_s: list[float] = []

    def is_real(silent_s: float) -> bool:
        asked_s.append(silent_s)
        return len(asked_s) == 3

    with a_router(endpoint) as router, a_queryable(router, "demo/a"):
        config = lister_config(ZenohOptions(connect=[endpoint]))
        listing = Listing(config, ["**"], "demo/a", is_real, lambda _: None, silence_s=0.2)
        assert listing.await_first(5.0)
    try:
        assert soon(lambda: len(asked_s) == 3)
        n_started = listing.n_started
        assert soon(lambda: listing.n_started > n_started + 1)
        assert len(asked_s) == 3
    finally:
        listing.close()


def test_a_network_whose_router_answers_is_not_reported_for_a_while() -> None:
    with a_bridge() as there:
        report = there.applications.queryables._silence_report("east")
        assert not report(4.0)
        assert there.leaks == []
        assert report(31.0)
        assert "has not listed its queryables for 31 s" in there.leaks[0]
