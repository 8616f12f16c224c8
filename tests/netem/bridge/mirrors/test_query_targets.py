"""Which queryables execute a query across the bridge. The oracle is a Zenoh router."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any

import pytest
import zenoh

from tests.common.runtime.live_zenoh import a_client, a_router, settle, soon
from tests.netem.bridge.live_bridge import a_bridge, n_mirrored
from tis.common.runtime.ports import free_endpoints
from tis.netem.bridge.mirrors.queries import TARGETS, QueryTargetName

pytestmark = pytest.mark.live

Outcomes = dict[tuple[tuple[bool, bool], QueryTargetName], tuple[int, int]]

_TWO_COMPLETE = (True, True)
_SETS = (_TWO_COMPLETE, (True, False), (False, False))
_POINTS = zenoh.TimestampInstrumentationBuilder().set_send(True).set_receive(True).build()


@contextmanager
def queryables(sessions: Sequence[zenoh.Session], complete: Sequence[bool]) -> Iterator[list[int]]:
    """Declare one queryable for each session; yield how often each has executed a query."""
    executed = [0] * len(complete)

    def taker(number: int) -> Any:
        def take(query: zenoh.Query) -> None:
            executed[number] += 1
            with query:
                query.reply("demo/a", str(number))

        return zenoh.handlers.Callback(take, indirect=False)

    with ExitStack() as stack:
        for number, (session, is_complete) in enumerate(zip(sessions, complete, strict=True)):
            stack.enter_context(session.declare_queryable("demo/**", taker(number), complete=is_complete))
        settle(*sessions)
        yield executed


def outcome(asker: zenoh.Session, target: zenoh.QueryTarget, executed: list[int]) -> tuple[int, int]:
    """Ask once; return how many queryables executed it, and the replies."""
    before = sum(executed)
    replies = list(asker.get("demo/a", target=target, consolidation=zenoh.ConsolidationMode.NONE, timeout=3.0))
    return sum(executed) - before, sum(reply.ok is not None for reply in replies)


def native() -> Outcomes:
    """Return the outcomes with one Zenoh router, which has the two queryables and the querier."""
    endpoint, _ = free_endpoints()
    with a_router(endpoint), a_client(endpoint) as one, a_client(endpoint) as two, a_client(endpoint) as asker:
        return outcomes(asker, (one, two), lambda _: None)


def bridged(query_target: QueryTargetName) -> Outcomes:
    """Return the outcomes with the two queryables beyond a bridge."""
    with a_bridge(query_target=query_target) as there, a_client(there.endpoints["east"]) as other:

        def wait(complete: Sequence[bool]) -> None:
            # two queryables of one expression have one mirror, which is complete if either is
            mirrors = there.applications.queryables._mirrors["forward"]
            assert soon(lambda: [one.complete for one in tuple(mirrors.values()) if one.listed] == [any(complete)])
            settle(there.west)

        return outcomes(there.west, (there.east, other), wait)


def outcomes(
    asker: zenoh.Session, there: Sequence[zenoh.Session], wait: Callable[[Sequence[bool]], None]
) -> Outcomes:
    found: Outcomes = {}
    for complete in _SETS:
        with queryables(there, complete) as executed:
            wait(complete)
            for name, target in TARGETS.items():
                found[complete, name] = outcome(asker, target, executed)
    return found


def test_zenoh_s_own_default_executes_a_query_as_often_as_a_router_does() -> None:
    """Only those that ask for other than Zenoh's default differ, where several queryables match."""
    expected, got = native(), bridged("best_matching")
    assert expected[_TWO_COMPLETE, "best_matching"] == (1, 1)
    assert {case for case in expected if got[case] != expected[case]} == {
        (_TWO_COMPLETE, "all"),
        (_TWO_COMPLETE, "all_complete"),
        ((True, False), "all"),
    }
    for case in expected.keys() - {case for case in expected if got[case] == expected[case]}:
        assert got[case] == (1, 1)


def test_all_queryables_are_queried_on_request() -> None:
    expected, got = native(), bridged("all")
    assert {case for case in expected if got[case] != expected[case]} == {
        (_TWO_COMPLETE, "best_matching"),
        ((True, False), "best_matching"),
        ((True, False), "all_complete"),
    }
    assert got[_TWO_COMPLETE, "best_matching"] == (2, 2)


def test_points_of_timestamps_cross_with_messages_and_queries() -> None:
    """The stamps before the bridge do not: the binding cannot put them."""
    stacks: list[zenoh.TimestampStack | None] = []

    def take(query: zenoh.Query) -> None:
        stacks.append(query.timestamp_stack)
        query.drop()  # type: ignore[no-untyped-call]

    with a_bridge() as there, there.east.declare_queryable("demo/**", take, complete=True):
        assert soon(lambda: n_mirrored(there) == 1)
        with there.east.declare_subscriber("demo/**", lambda sample: stacks.append(sample.timestamp_stack)):
            settle(there.east, there.west)
            there.west.put("demo/a", b"", timestamp_instrumentation=_POINTS)
            assert soon(lambda: len(stacks) == 1)
            there.west.delete("demo/a", timestamp_instrumentation=_POINTS)
            assert soon(lambda: len(stacks) == 2)
            there.west.put("demo/a", b"")
            assert soon(lambda: len(stacks) == 3)
            list(there.west.get("demo/a", timestamp_instrumentation=_POINTS, timeout=3.0))
            assert soon(lambda: len(stacks) == 4)
    assert stacks.pop(2) is None
    for stack in stacks:
        assert stack is not None
        points = [record.point for record in stack.records]
        assert points == [zenoh.InterceptionPoint.SEND, zenoh.InterceptionPoint.RECEIVE]
