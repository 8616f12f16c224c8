import pytest

from tis.common.errors import InputError
from tis.common.runtime.zenoh_session import ZenohOptions
from tis.netem.bridge.sides import Place, check_places, lease_s


def test_each_side_needs_a_place() -> None:
    with pytest.raises(InputError) as found:
        check_places({"west": Place(), "east": Place()})
    assert [str(fault) for fault in found.value.faults] == [
        "netem: --west: is required, or --connect-west: where that network is",
        "netem: --east: is required, or --connect-east: where that network is",
    ]


@pytest.mark.parametrize("other", ["tcp/127.0.0.1:7447", "tcp/localhost:7447", "tcp/127.0.0.1:7447?prio=1"])
def test_the_two_sides_cannot_have_one_endpoint(other: str) -> None:
    with pytest.raises(InputError, match="--east: must not be an endpoint of the other side"):
        check_places({"west": Place(listen=("tcp/127.0.0.1:7447",)), "east": Place(connect=(other,))})


def test_a_side_may_listen_and_connect() -> None:
    check_places({"west": Place(("tcp/127.0.0.1:1",), ("tcp/127.0.0.1:2",)), "east": Place(("tcp/127.0.0.1:3",))})


def test_the_lease_is_the_configuration_s_own() -> None:
    assert lease_s(ZenohOptions()) == 2.0
    assert lease_s(ZenohOptions(cfg=["transport/link/tx/lease:750"])) == 0.75


def test_a_peer_that_connects_is_said_to_listen() -> None:
    place = Place(connect=("tcp/127.0.0.1:1",))
    assert place.described("client") == "connected to tcp/127.0.0.1:1"
    assert place.described("peer").endswith(":1, as a peer, which listens on a free port of every interface")
    assert Place(listen=("tcp/127.0.0.1:1",)).described("peer") == "listening on tcp/127.0.0.1:1"
