"""Applications that find each other past netem are noticed, however well they behave towards netem."""

import json
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import pytest
import zenoh

from tests.common.runtime.live_zenoh import a_client, soon
from tests.netem.bridge.live_bridge import two_routers
from tis.common.channels import Network
from tis.common.runtime.zenoh_session import ZenohOptions
from tis.netem.bridge.bypass import Bypasses
from tis.netem.bridge.scouting import Scouting
from tis.netem.bridge.sides import scout_config

pytestmark = pytest.mark.live

ADDRESS = "224.0.0.224:27446"  # of this test alone
OPTIONS = ZenohOptions(cfg=[f'scouting/multicast/address:"{ADDRESS}"'])


@contextmanager
def a_default_application(endpoint: str, scouting: bool = True) -> Iterator[zenoh.Session]:
    """Open a session as Zenoh's examples do with ``-e``: a peer."""
    config = zenoh.Config()
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/address", json.dumps(ADDRESS))
    config.insert_json5("scouting/multicast/enabled", json.dumps(scouting))
    with zenoh.open(config) as session:
        yield session


@contextmanager
def _an_application_of_neither_network() -> Iterator[zenoh.Session]:
    config = zenoh.Config()
    config.insert_json5("scouting/multicast/address", json.dumps(ADDRESS))
    with zenoh.open(config) as session:
        yield session


class _Told:
    def __init__(self, sessions: dict[Network, zenoh.Session]) -> None:
        self.leaks: list[str] = []
        self.more: list[str] = []
        self.bypasses = Bypasses(self.leaks.append, self.more.append)
        self.dangers: list[str] = []
        self.scouting = Scouting(sessions, scout_config(OPTIONS), self.bypasses, self.dangers.append)

    def look(self, now_s: float, *expected: zenoh.Session) -> None:
        """Look once; time passes for the judge only, the applications have a moment to answer.

        Only they are waited for: others on the wire, of another run of this test, may answer too.
        """
        self.scouting.step(now_s)
        assert soon(lambda: {str(session.zid()) for session in expected} <= self.scouting._found.keys())
        self.scouting.step(now_s + 1)


def test_peers_of_both_networks_that_scout_are_a_bypass_and_one_is_none() -> None:
    with two_routers() as (sessions, endpoints), a_default_application(endpoints["west"]) as west:
        told = _Told(sessions)
        assert soon(lambda: bool(sessions["west"].info.peers_zid()))
        told.look(0, west)
        assert told.leaks == []
        with a_default_application(endpoints["east"]) as east:
            assert soon(lambda: bool(sessions["east"].info.peers_zid()))
            assert soon(lambda: bool(east.info.peers_zid())), "they have not found each other"
            told.look(10, west, east)
            told.look(20, west, east)
            assert len(told.leaks) == 1
            assert "find each other past netem by multicast scouting: let them be clients" in told.leaks[0]
            assert told.bypasses.n == 1
            assert told.dangers == []
            told.look(100, west, east)
            assert told.dangers == told.leaks  # said again, counted once
        told.scouting.close()


def test_a_pair_that_its_gossip_has_told_of_is_not_counted_again() -> None:
    with (
        two_routers() as (sessions, endpoints),
        a_default_application(endpoints["west"]) as west,
        a_default_application(endpoints["east"]) as east,
    ):
        told = _Told(sessions)
        told.bypasses.add("linked", {(str(west.zid()), str(east.zid()))})
        assert soon(lambda: all(session.info.peers_zid() for session in sessions.values()))
        told.look(0, west, east)
        told.look(10, west, east)
        told.scouting.close()
    assert (told.leaks, told.bypasses.n, told.dangers) == (["linked"], 1, [])
    (scouted,) = told.more
    assert "find each other past netem by multicast scouting" in scouted


def test_clients_and_peers_without_multicast_are_no_bypass() -> None:
    with two_routers() as (sessions, endpoints), ExitStack() as stack:
        quiet = set()
        for endpoint in endpoints.values():
            quiet.add(str(stack.enter_context(a_client(endpoint)).zid()))
            quiet.add(str(stack.enter_context(a_default_application(endpoint, scouting=False)).zid()))
        assert soon(lambda: all(session.info.peers_zid() for session in sessions.values()))
        told = _Told(sessions)
        heard = stack.enter_context(_an_application_of_neither_network())  # whose answer shows that all had the time
        told.look(0, heard)
        assert not quiet & told.scouting._found.keys()
        told.scouting.close()
        assert told.leaks == told.dangers == []
