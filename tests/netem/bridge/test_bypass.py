"""netem refuses to emulate a network that can be got round, and to make a ring."""

import time
from contextlib import ExitStack
from pathlib import Path

import pytest
import zenoh

from tests.common.runtime.live_zenoh import a_client, a_router, soon
from tests.netem.bridge.live_bridge import bridging, two_routers
from tests.netem.bridge.test_gossip import link_state
from tis.common.channels import Network
from tis.common.errors import EXIT_INVALID_RUN, PeerError
from tis.common.runtime.ports import free_endpoints
from tis.common.runtime.zenoh_session import ZenohOptions, configure
from tis.netem.bridge.between import between
from tis.netem.bridge.bypass import Bypasses, Watch, refuse_one_router
from tis.netem.bridge.gossip import Gossip

pytestmark = pytest.mark.live
_GOSSIPS = ("scouting/gossip/enabled:true",)  # Zenoh's default


def _ignore(text: str) -> None:
    raise AssertionError(text)


def _none() -> Bypasses:
    return Bypasses(_ignore, _ignore)


def test_two_programs_are_one_way_by_whatever_they_are_noticed() -> None:
    told: list[str] = []
    more: list[str] = []
    for first, then in (("scouting", "links"), ("links", "scouting")):
        bypasses = Bypasses(told.append, more.append)
        bypasses.add(first, {("a", "b")})
        bypasses.add(then, {("a", "b")})
        assert (told, more, bypasses.n) == ([first], [then], 1)
        bypasses.add("scouting", {("a", "b"), ("c", "b")})
        bypasses.add("a router")
        assert (told[1:], bypasses.n) == (["scouting", "a router"], 3)
        told.clear()
        more.clear()


def test_two_networks_with_a_side_each_are_accepted() -> None:
    with two_routers() as (sessions, endpoints), a_client(endpoints["west"]), a_client(endpoints["east"]):
        watch = Watch(sessions, ["**"], _none())
        watch.refuse_leaks()
        watch.close()


def test_a_client_of_both_networks_forwards_nothing() -> None:
    """A recorder that listens on both networks joins nothing by that."""
    heard: list[int] = []
    with two_routers() as (sessions, endpoints), ExitStack() as stack:
        for endpoint in endpoints.values():
            session = stack.enter_context(a_client(endpoint))
            stack.enter_context(session.declare_subscriber("**", lambda _: heard.append(1)))
        watch = Watch(sessions, ["**"], _none())
        watch.refuse_leaks()
        watch.close()


def test_a_router_that_joins_the_two_networks_is_refused() -> None:
    third, _ = free_endpoints()
    with two_routers() as (sessions, endpoints), a_router(third, *endpoints.values()):
        heard: list[int] = []
        with sessions["east"].declare_subscriber("t/probe", lambda _: heard.append(1)):
            assert soon(lambda: bool(sessions["west"].put("t/probe", b"") or heard))
        watch = Watch(sessions, ["**"], _none())
        with pytest.raises(PeerError, match="netem: zenoh: messages from east reach the other network past netem"):
            watch.refuse_leaks()
        watch.close()


def test_a_bypass_that_comes_later_is_found() -> None:
    third, _ = free_endpoints()
    with two_routers() as (sessions, endpoints):
        leaks: list[str] = []
        watch = Watch(sessions, ["**"], Bypasses(leaks.append, _ignore))
        watch.refuse_leaks()
        assert leaks == []
        with a_router(third, *endpoints.values()):
            for _ in range(20):
                watch.probe()
                time.sleep(0.05)
        # on a busy machine it may show as a ring first
        assert set(leaks) >= {
            "messages from east reach the other network past netem",
            "messages from west reach the other network past netem",
        }
        watch.close()


def test_a_peer_of_both_networks_is_told_once() -> None:
    with two_routers() as (sessions, endpoints):
        leaks: list[str] = []
        watch = Watch(sessions, ["**"], Bypasses(leaks.append, _ignore))
        watch.refuse_leaks()
        options = ZenohOptions(connect=tuple(endpoints.values()), listen=("tcp/127.0.0.1:0",))

        def told() -> bool:
            watch.probe()
            return bool(leaks)

        with zenoh.open(configure("peer", options)) as peer:
            assert soon(told)
            watch.probe()
            assert leaks == [
                f"the peer {peer.zid()} is connected to both networks: what it sends reaches both past netem"
            ]
        watch.close()


@pytest.mark.parametrize(("keys", "is_ring"), [(["demo/**"], True), (["**"], True), (["other/**"], False)])
def test_a_second_netem_between_the_same_networks_is_a_ring_when_they_share_keys(
    keys: list[str], is_ring: bool
) -> None:
    with (
        two_routers() as (sessions, endpoints),
        bridging(sessions, endpoints, keys=["demo/**"]),
        ExitStack() as stack,
    ):
        second = {network: stack.enter_context(a_client(endpoint)) for network, endpoint in endpoints.items()}
        watch = Watch(second, keys, _none())
        if is_ring:
            with pytest.raises(PeerError, match="another netem joins the two networks: messages from east would go"):
                watch.refuse_leaks()
        else:
            watch.refuse_leaks()
        watch.close()


def test_both_sides_on_one_router_are_refused() -> None:
    with two_routers() as (_, endpoints), a_client(endpoints["west"]) as one, a_client(endpoints["west"]) as two:
        with a_client(endpoints["east"]) as three:
            refuse_one_router({"west": one, "east": three})
        with pytest.raises(PeerError, match="it would be one network"):
            refuse_one_router({"west": one, "east": two})


def test_peers_of_the_two_networks_that_are_connected_to_each_other_are_told(tmp_path: Path) -> None:
    """Neither listens where the other would find it by itself: one is given the endpoint of the other."""
    third, _ = free_endpoints()
    with between(run_dir=tmp_path / "run") as net:
        one = configure("peer", ZenohOptions(connect=(net.east,), listen=(third,), cfg=_GOSSIPS))
        other = configure("peer", ZenohOptions(connect=(net.west, third), listen=("tcp/127.0.0.1:0",), cfg=_GOSSIPS))
        with zenoh.open(one) as east, zenoh.open(other) as west:
            assert soon(lambda: bool(net.n_bypasses()))
            pair = f"the peers {west.zid()} in the west and {east.zid()} in the east are connected to each other"
    assert net.warnings == net.bypasses == [f"{pair}: what they send reaches the other past netem"]
    assert net.exit_code == EXIT_INVALID_RUN


def test_peers_of_one_network_may_be_connected_to_each_other(tmp_path: Path) -> None:
    third, _ = free_endpoints()
    with between(run_dir=tmp_path / "run") as net:
        one = configure("peer", ZenohOptions(connect=(net.west,), listen=(third,), cfg=_GOSSIPS))
        other = configure("peer", ZenohOptions(connect=(net.west, third), listen=("tcp/127.0.0.1:0",), cfg=_GOSSIPS))
        with zenoh.open(one), zenoh.open(other) as west, a_client(net.east):
            assert soon(lambda: len(list(west.info.peers_zid())) == 1)
            time.sleep(0.3)
    assert (net.warnings, net.exit_code) == ([], 0)


def test_a_peer_that_has_the_endpoint_of_a_peer_only_is_told_and_not_counted(tmp_path: Path) -> None:
    """It may be a helper of this one, and need not gossip: the other one tells."""
    third, _ = free_endpoints()
    with between(run_dir=tmp_path / "run") as net:
        one = configure("peer", ZenohOptions(connect=(net.east,), listen=(third,), cfg=_GOSSIPS))
        other = configure("peer", ZenohOptions(connect=(third,), listen=("tcp/127.0.0.1:0",)))
        with zenoh.open(one) as east, zenoh.open(other) as alone:
            assert soon(lambda: bool(net.warnings))
            told = f"the peer {east.zid()} is connected to {alone.zid()}, which is in neither network"
            time.sleep(0.5)
    assert net.warnings == [f"{told}: what they send each other does not cross netem"]
    assert (net.bypasses, net.exit_code) == ([], 0)


def _watching(sessions: dict[Network, zenoh.Session], told: list[str], more: list[str]) -> tuple[Watch, Gossip]:
    gossip = Gossip()
    watch = Watch(sessions, ["**"], Bypasses(told.append, more.append), gossip)
    watch.refuse_leaks()
    return watch, gossip


@pytest.mark.parametrize("of_one_network", [True, False])
def test_a_program_that_has_left_was_in_a_network(of_one_network: bool) -> None:
    """A peer goes on to tell its link to one that has closed; only a program never seen is of neither network."""
    told: list[str] = []
    more: list[str] = []
    with two_routers() as (sessions, endpoints), ExitStack() as stack:
        watch, gossip = _watching(sessions, told, more)
        one, other = (
            stack.enter_context(
                zenoh.open(configure("peer", ZenohOptions(connect=(endpoint,), listen=("tcp/127.0.0.1:0",))))
            )
            for endpoint in (endpoints["west"], endpoints["west" if of_one_network else "east"])
        )
        names = {str(one.zid()), str(other.zid())}
        assert soon(lambda: names <= {str(z) for s in sessions.values() for z in s.info.peers_zid()})
        gossip.take(link_state(str(one.zid()), str(other.zid()), "ab"))
        watch.look()
        assert len(told) == (0 if of_one_network else 1)
        other.close()  # type: ignore[no-untyped-call]
        assert soon(lambda: str(other.zid()) not in {str(z) for s in sessions.values() for z in s.info.peers_zid()})
        for _ in range(5):
            watch.probe()
        assert more == [
            f"the peer {one.zid()} is connected to ab, which is in neither network: "
            "what they send each other does not cross netem"
        ]
        watch.close()
