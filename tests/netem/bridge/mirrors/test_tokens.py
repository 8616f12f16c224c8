"""Liveliness tokens through a real bridge."""

import time
from contextlib import ExitStack

import pytest
import zenoh

from tests.common.runtime.live_zenoh import a_client, soon
from tests.netem.bridge.live_bridge import a_bridge, delays, n_tokens
from tis.common.channels import Network

pytestmark = pytest.mark.live

Event = tuple[zenoh.SampleKind, str]
PUT, DELETE = zenoh.SampleKind.PUT, zenoh.SampleKind.DELETE


class Watcher:
    """What a liveliness subscriber hears, with the moment."""

    def __init__(self, session: zenoh.Session, key: str = "**") -> None:
        self.events: list[Event] = []
        self.at_s: list[float] = []
        self._subscriber = session.liveliness().declare_subscriber(key, self._take, history=True)

    def _take(self, sample: zenoh.Sample) -> None:
        self.at_s.append(time.monotonic())
        self.events.append((sample.kind, str(sample.key_expr)))


def alive(session: zenoh.Session) -> list[str]:
    """Ask a session that has no liveliness subscriber: a get beside one sometimes misses what that has just heard."""
    replies = session.liveliness().get("**", timeout=1.0)
    return [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]


@pytest.mark.parametrize("home", ["west", "east"])
def test_a_token_is_seen_on_the_other_side_until_it_goes(home: Network) -> None:
    other: Network = "east" if home == "west" else "west"
    with a_bridge() as there, a_client(there.endpoints[other]) as observer:
        here, away = (there.west, there.east) if home == "west" else (there.east, there.west)
        early = Watcher(away)
        token = here.liveliness().declare_token("group/one")
        assert soon(lambda: early.events == [(PUT, "group/one")])
        assert soon(lambda: alive(observer) == ["group/one"])
        late = Watcher(away)
        assert soon(lambda: late.events == [(PUT, "group/one")])
        token.undeclare()  # type: ignore[no-untyped-call]
        assert soon(lambda: early.events[1:] == [(DELETE, "group/one")])
        assert soon(lambda: alive(observer) == [])
        assert soon(lambda: n_tokens(there) == 0)
        time.sleep(0.1)  # time for an echo
        assert early.events == [(PUT, "group/one"), (DELETE, "group/one")]
        assert there.applications.tokens.n_changes == 2


def test_a_token_that_was_there_before_the_bridge_crosses_and_takes_the_delay() -> None:
    with a_bridge(**delays(400.0)) as there:
        watcher = Watcher(there.east)
        began_s = time.monotonic()
        with there.west.liveliness().declare_token("group/one"):
            assert soon(lambda: bool(watcher.events))
            assert watcher.at_s[0] - began_s >= 0.4
            time.sleep(0.02)
            ended_s = time.monotonic()
        assert soon(lambda: len(watcher.events) == 2)
        assert watcher.at_s[1] - ended_s >= 0.4
        assert there.bridge.links["forward"].offered == 2  # each waits once
        assert there.bridge.links["feedback"].offered == 0


def test_a_lost_change_is_sent_again_until_it_arrives() -> None:
    outage = [{"at_s": 0.0, "for_s": 0.5, "set": {"outage": True}}]
    with a_bridge(timeline=outage, lease_s=5.0) as there:
        watcher = Watcher(there.east)
        with there.west.liveliness().declare_token("group/one"):
            time.sleep(0.15)
            assert watcher.events == []
            assert soon(lambda: watcher.events == [(PUT, "group/one")])
        assert soon(lambda: watcher.events[1:] == [(DELETE, "group/one")])
        assert there.applications.tokens.n_retries >= 1
        assert there.applications.tokens.n_cuts == 0


def test_what_changed_twice_while_nothing_passed_never_shows() -> None:
    outage = [{"at_s": 0.0, "for_s": 0.6, "set": {"outage": True}}]
    with a_bridge(timeline=outage, lease_s=5.0) as there:
        watcher = Watcher(there.east)
        with there.west.liveliness().declare_token("group/one"):
            assert soon(lambda: there.applications.tokens.n_changes == 1)
        assert soon(lambda: there.bridge.links["forward"].released == 1)
        time.sleep(0.05)
        assert watcher.events == []


@pytest.mark.parametrize("direction", ["forward", "feedback"])
def test_an_outage_beyond_the_lease_takes_the_tokens_away_until_it_is_over(direction: str) -> None:
    """Either way: a connection of which one direction is silent is given up."""
    outage = [{"at_s": 0.6, "for_s": 0.8, "direction": direction, "set": {"outage": True}}]
    before_s = time.monotonic()
    with a_bridge(timeline=outage, lease_s=0.3) as there:
        watcher = Watcher(there.east)
        with there.west.liveliness().declare_token("group/one"):
            assert soon(lambda: len(watcher.events) == 3)
            assert watcher.events == [(PUT, "group/one"), (DELETE, "group/one"), (PUT, "group/one")]
            assert watcher.at_s[1] - before_s >= 0.6 + 0.3
            assert watcher.at_s[2] - before_s >= 0.6 + 0.8
            assert there.applications.tokens.n_cuts == 1


def test_an_outage_within_the_lease_is_not_noticed() -> None:
    outage = [{"at_s": 0.3, "for_s": 0.3, "set": {"outage": True}}]
    with a_bridge(timeline=outage, lease_s=0.5) as there:
        watcher = Watcher(there.east)
        with there.west.liveliness().declare_token("group/one"):
            assert soon(lambda: watcher.events == [(PUT, "group/one")])
            time.sleep(0.7)
            assert watcher.events == [(PUT, "group/one")]


def test_a_token_of_the_same_name_on_both_sides_lives_as_long_as_either() -> None:
    both, neither = [["same"], ["same"]], [list[str](), list[str]()]
    with a_bridge() as there, ExitStack() as stack:
        # a client is not told of its own tokens
        observers = [stack.enter_context(a_client(endpoint)) for endpoint in there.endpoints.values()]

        def seen() -> list[list[str]]:
            return [alive(session) for session in observers]

        one = there.west.liveliness().declare_token("same")
        assert soon(lambda: seen() == both)
        two = there.east.liveliness().declare_token("same")
        time.sleep(0.1)
        one.undeclare()  # type: ignore[no-untyped-call]
        time.sleep(0.2)
        assert soon(lambda: seen() == both)
        two.undeclare()  # type: ignore[no-untyped-call]
        assert soon(lambda: seen() == neither)
        time.sleep(0.2)
        assert seen() == neither
        assert n_tokens(there) == 0


def test_the_control_plane_of_a_run_does_not_cross() -> None:
    with a_bridge() as there:
        watcher = Watcher(there.east, "tis/@tis/**")
        with there.west.liveliness().declare_token("tis/@tis/side/surgeon/0"):
            time.sleep(0.2)
        assert watcher.events == []
