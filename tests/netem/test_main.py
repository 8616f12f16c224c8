"""netem refuses to emulate a network that can be got round."""

from collections.abc import Iterator, Mapping
from contextlib import ExitStack

import pytest
import zenoh

from common.channels import Network
from common.errors import InputError, PeerError
from common.runtime.control import ControlKeys
from common.runtime.side import SideOptions
from common.runtime.status import Status
from common.runtime.zenoh_session import ZenohOptions
from common.scenario_io import build_scenario
from deploy.launch import free_endpoints
from netem.__main__ import refuse_bypass, run_netem
from tests.common.runtime.live_zenoh import a_client, a_router, soon

KEYS = ControlKeys("t")
Sessions = Mapping[Network, zenoh.Session]


@pytest.fixture
def west_and_east() -> tuple[str, str]:
    return free_endpoints()


@pytest.fixture
def sessions(west_and_east: tuple[str, str]) -> Iterator[Sessions]:
    """The two networks of netem."""
    west, east = west_and_east
    with a_router(west) as one, a_router(east) as two:
        yield {"west": one, "east": two}


def _joined(sessions: Sessions) -> bool:
    heard: list[int] = []
    with sessions["east"].declare_subscriber("t/probe", lambda _: heard.append(1)):
        return soon(lambda: bool(sessions["west"].put("t/probe", b"") or heard))


@pytest.mark.live
def test_two_networks_with_a_side_each_are_accepted(sessions: Sessions, west_and_east: tuple[str, str]) -> None:
    with a_client(west_and_east[0]), a_client(west_and_east[1]):
        refuse_bypass(sessions, KEYS)


@pytest.mark.live
def test_a_client_of_both_networks_forwards_nothing(sessions: Sessions, west_and_east: tuple[str, str]) -> None:
    """A recorder that listens on both networks joins nothing by that."""
    heard: list[int] = []
    with ExitStack() as stack:
        for endpoint in west_and_east:
            session = stack.enter_context(a_client(endpoint))
            stack.enter_context(session.declare_subscriber("t/**", lambda _: heard.append(1)))
        refuse_bypass(sessions, KEYS)


@pytest.mark.live
def test_a_router_that_joins_the_two_networks_is_refused(sessions: Sessions, west_and_east: tuple[str, str]) -> None:
    west, east = west_and_east
    endpoint, _ = free_endpoints()
    with a_router(endpoint, west, east):
        assert _joined(sessions)
        with pytest.raises(PeerError, match="netem: zenoh: messages from west reach the other network past netem"):
            refuse_bypass(sessions, KEYS)


@pytest.mark.parametrize("endpoints", [["tcp/127.0.0.1:0"], ["tcp/127.0.0.1:0"] * 3])
def test_other_than_two_places_to_listen_are_a_mistake_of_the_user(
    endpoints: list[str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    scenario = build_scenario({"version": 1, "name": "s", "source": {"kind": "synthetic"}}, "s.yaml")
    run_dir = tmp_path_factory.mktemp("netem") / "run"
    options = SideOptions(run_dir, ZenohOptions(listen=endpoints))
    with pytest.raises(InputError, match="--listen: must be given twice, west first, then east"):
        run_netem(scenario, options, Status("netem", as_events=False))
    assert not run_dir.exists()
