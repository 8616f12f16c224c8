"""The ways of the client that lists queryables: which there are, and that nothing is left of them."""

import json
import stat
from contextlib import ExitStack
from pathlib import Path

import pytest

from tis.common.channels import Network
from tis.common.runtime.zenoh_session import ZenohOptions
from tis.netem.bridge.sides import Place, lister_config, open_private_endpoints

_PLACES: dict[Network, Place] = {
    "west": Place(listen=("tcp/127.0.0.1:1",)),
    "east": Place(connect=("tcp/127.0.0.1:2",)),
}


def test_a_door_is_where_netem_listens_and_only_its_user_can_reach_it() -> None:
    with ExitStack() as stack:
        endpoints = open_private_endpoints(stack, _PLACES, ZenohOptions())
        assert endpoints.keys() == {"west"}
        folder = Path(endpoints["west"].removeprefix("unixsock-stream/")).parent
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert not folder.exists()


@pytest.mark.parametrize(("protocols", "n_endpoints"), [('["tcp","tls"]', 0), ('["tcp","unixsock-stream"]', 1)])
def test_there_is_none_where_the_user_allows_no_unix_sockets(protocols: str, n_endpoints: int) -> None:
    with ExitStack() as stack:
        assert (
            len(open_private_endpoints(stack, _PLACES, ZenohOptions(cfg=[f"transport/link/protocols:{protocols}"])))
            == n_endpoints
        )


def test_there_is_none_where_a_socket_s_path_would_be_too_long(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    far = tmp_path / ("x" * 100)
    far.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(far))
    with ExitStack() as stack:
        assert open_private_endpoints(stack, _PLACES, ZenohOptions()) == {}


def test_who_lists_reads_its_own_admin_space_and_listens_to_nobody() -> None:
    own = ["adminspace/enabled:false", 'listen/endpoints:["tcp/127.0.0.1:1"]', "transport/link/tx/lease:750"]
    config = lister_config(ZenohOptions(connect=["tcp/127.0.0.1:2"], listen=["tcp/127.0.0.1:3"], cfg=own))
    read = {key: json.loads(config.get_json(key)) for key in ("mode", "listen/endpoints", "connect/endpoints")}
    assert read == {"mode": "client", "listen/endpoints": [], "connect/endpoints": ["tcp/127.0.0.1:2"]}
    assert config.get_json("adminspace/enabled") == "true"
    assert config.get_json("transport/link/tx/lease") == "750"
