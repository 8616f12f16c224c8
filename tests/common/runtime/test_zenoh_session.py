"""Configurations and sessions: what the user gives counts, what is wrong is one line."""

import json
import socket
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import pytest
import zenoh

from tests.common.runtime.live_zenoh import a_client, a_network, a_router, settle, soon
from tis.common.errors import InputError, PeerError
from tis.common.runtime.ports import free_endpoints
from tis.common.runtime.zenoh_session import ZenohOptions, bypasses, configure, open_client, open_router


def _value(config: zenoh.Config, key: str) -> Any:
    return json.loads(config.get_json(key))


def _faults(options: ZenohOptions) -> list[str]:
    with pytest.raises(InputError) as caught:
        configure("client", options)
    return [str(fault) for fault in caught.value.faults]


def test_by_default_nobody_is_found_who_was_not_named() -> None:
    config = configure("client", ZenohOptions(connect=["tcp/127.0.0.1:7447"]))
    assert _value(config, "mode") == "client"
    assert _value(config, "scouting/multicast/enabled") is False
    assert _value(config, "scouting/gossip/enabled") is False
    assert _value(config, "transport/shared_memory/enabled") is False
    assert _value(config, "connect/endpoints") == ["tcp/127.0.0.1:7447"]


def test_a_router_hears_gossip_and_tells_none_unless_the_user_says_otherwise(tmp_path: Path) -> None:
    listening = ZenohOptions(listen=["tcp/127.0.0.1:7447"])
    config = configure("router", listening)
    assert _value(config, "scouting/gossip/enabled") is True
    nobody: dict[str, list[str]] = {"router": [], "peer": []}
    assert _value(config, "scouting/gossip/target") == _value(config, "scouting/gossip/autoconnect") == nobody
    path = tmp_path / "zenoh.json5"
    path.write_text("{scouting: {gossip: {enabled: false}}}")
    assert _value(configure("router", replace(listening, config=path)), "scouting/gossip/enabled") is False
    config = configure("router", replace(listening, cfg=["scouting/gossip/enabled:true"]))
    assert _value(config, "scouting/gossip/enabled") is True
    assert _value(config, "scouting/gossip/target") is None


def test_settings_override_the_defaults_and_the_endpoints() -> None:
    options = ZenohOptions(
        connect=["tcp/127.0.0.1:7447"],
        cfg=["transport/link/tx/lease:9000", 'connect/endpoints:["tcp/127.0.0.1:7450"]', "mode:'peer'"],
        insecure=True,  # a peer listens on every interface
    )
    config = configure("client", options)
    assert _value(config, "transport/link/tx/lease") == 9000
    assert _value(config, "connect/endpoints") == ["tcp/127.0.0.1:7450"]
    assert _value(config, "mode") == "peer"


def test_a_file_overrides_the_defaults_options_override_the_file(tmp_path: Path) -> None:
    path = tmp_path / "zenoh.json5"
    path.write_text(
        "{connect: {endpoints: ['tcp/10.0.0.1:1'], timeout_ms: 5000},\n"
        " listen: {endpoints: ['tcp/10.0.0.2:2']}, // a comment, as JSON5 has it\n"
        " scouting: {multicast: {enabled: true}}}"
    )
    config = configure("client", ZenohOptions(connect=["tcp/127.0.0.1:7447"], config=path))
    assert _value(config, "connect/timeout_ms") == 5000
    assert _value(config, "scouting/multicast/enabled") is True
    assert _value(config, "scouting/gossip/enabled") is False
    assert _value(config, "connect/endpoints") == ["tcp/127.0.0.1:7447"]
    assert _value(config, "listen/endpoints") == ["tcp/10.0.0.2:2"]


@pytest.mark.parametrize(
    ("item", "line"),
    [
        ("nocolon", "--cfg: nocolon: must read KEY:VALUE"),
        ("fnord:1", "zenoh: fnord: "),
        ("transport/link/tx/lease:soon", "zenoh: transport/link/tx/lease: "),
        ("transport/link/tx/lease:", "zenoh: transport/link/tx/lease: "),
        ("mode:'queen'", "zenoh: mode: "),
    ],
)
def test_a_bad_setting_is_one_line_with_its_key(item: str, line: str) -> None:
    faults = _faults(ZenohOptions(cfg=[item]))
    assert len(faults) == 1
    assert faults[0].startswith(line)
    assert "\n" not in faults[0]
    assert ".rs" not in faults[0]


def test_all_bad_settings_and_endpoints_come_at_once() -> None:
    faults = _faults(ZenohOptions(connect=["nonsense"], listen=["tcp/"], cfg=["nocolon", "fnord:1"]))
    assert len(faults) == 4
    assert any(fault.startswith("zenoh: --connect: ") and "nonsense" in fault for fault in faults)


@pytest.mark.parametrize("text", ["{", "{fnord: 1}", "", None])
def test_a_bad_file_is_one_line_with_its_name(tmp_path: Path, text: str | None) -> None:
    path = tmp_path / "zenoh.json5"
    if text is not None:
        path.write_text(text)
    faults = _faults(ZenohOptions(config=path))
    assert len(faults) == 1
    assert faults[0].startswith(f"--config: {path}: ")
    assert len(faults[0].splitlines()) == 1
    assert len(faults[0]) > len(f"--config: {path}: ") + 10


@pytest.mark.live
@pytest.mark.parametrize("mode", ["router", "client"])
@pytest.mark.parametrize(
    ("listen", "cfg", "allowed"),
    [
        (["tcp/127.0.0.1:1"], (), True),
        (["tcp/0.0.0.0:1"], (), False),
        (["tcp/127.0.0.1:1", "tcp/192.168.1.5:1"], (), False),
        ([], ('listen/endpoints:["tcp/10.0.0.1:1"]',), False),
        (["tls/0.0.0.0:1"], (), False),
        (["tls/0.0.0.0:1"], ("transport/link/tls/enable_mtls:true",), True),
        (["tcp/0.0.0.0:1"], ("transport/link/tls/enable_mtls:true",), False),
        (["tcp/0.0.0.0:1"], ('transport/auth/usrpwd/dictionary_file:"users"',), True),
        (["tcp/0.0.0.0:1"], ('transport/auth/usrpwd/dictionary_file:"nobody"',), False),
        (["tcp/0.0.0.0:1"], ('transport/auth/usrpwd/dictionary_file:"halves"',), False),
        (["tcp/0.0.0.0:1"], ('transport/auth/usrpwd/dictionary_file:"missing"',), False),
    ],
)
def test_a_router_listens_beyond_loopback_only_with_proof_or_on_request(
    mode: Literal["router", "client"],
    listen: list[str],
    cfg: tuple[str, ...],
    allowed: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, text in (("users", "lab:secret\n"), ("nobody", "\n"), ("halves", "lab:\n:secret\nlab\n")):
        Path(name).write_text(text)
    options = ZenohOptions(listen=listen, cfg=cfg)
    if allowed or mode == "client":  # a client listens nowhere
        configure(mode, options)
    else:
        with pytest.raises(InputError, match="zenoh: --listen: must be on loopback without clients' certificates"):
            configure(mode, options)
    configure(mode, replace(options, insecure=True))


def test_an_endpoint_in_use_is_said_so() -> None:
    endpoint, _ = free_endpoints()
    host, port = endpoint.removeprefix("tcp/").split(":")
    config = configure("router", ZenohOptions(listen=[endpoint]))
    with socket.create_server((host, int(port))), pytest.raises(PeerError, match="cannot listen here: in use"):
        open_router(config, endpoint)


@pytest.mark.live
def test_a_client_tries_until_it_is_told_to_stop() -> None:
    endpoint, _ = free_endpoints()
    tries: list[float] = []
    config = configure("client", ZenohOptions(connect=[endpoint]))
    session = open_client(config, lambda: len(tries) >= 2, lambda: tries.append(time.monotonic()))
    assert session is None
    assert len(tries) == 2


@pytest.mark.live
def test_a_client_finds_a_router_that_comes_later() -> None:
    endpoint, _ = free_endpoints()
    routers: list[zenoh.Session] = []

    def start_router() -> None:
        if not routers:
            routers.append(open_router(configure("router", ZenohOptions(listen=[endpoint])), endpoint))

    config = configure("client", ZenohOptions(connect=[endpoint]))
    session = open_client(config, lambda: False, start_router)
    assert session is not None
    with routers[0], session:
        assert bypasses(session) == []


@pytest.mark.live
def test_a_side_must_see_one_router_and_no_peer() -> None:
    with a_network() as network:
        assert bypasses(network.client) == []
    with a_router(free_endpoints()[0]) as alone:
        assert bypasses(alone) == ["sees 0 Zenoh routers, must see exactly one, netem's"]


@pytest.mark.live
def test_a_peer_beside_the_router_is_named() -> None:
    endpoint, other = free_endpoints()
    peer = configure("client", ZenohOptions(connect=[endpoint], listen=[other], cfg=["mode:'peer'"]))
    side = configure("client", ZenohOptions(connect=[endpoint, other], cfg=["mode:'peer'"], insecure=True))
    with a_router(endpoint), zenoh.open(peer), zenoh.open(side) as session:
        assert soon(lambda: len(bypasses(session)) == 1)
        assert bypasses(session) == ["sees 1 Zenoh peers, must see none: they would bypass netem"]


@pytest.mark.live
def test_two_clients_of_a_router_see_each_others_messages() -> None:
    """The sessions as they are opened carry messages at all."""
    endpoint, _ = free_endpoints()
    heard: list[bytes] = []
    with a_router(endpoint), a_client(endpoint) as one, a_client(endpoint) as two:
        _held = two.declare_subscriber("t/key", lambda sample: heard.append(sample.payload.to_bytes()))
        assert soon(lambda: bool(one.put("t/key", b"x") or heard))
    assert set(heard) == {b"x"}


@pytest.mark.live
def test_a_router_waits_for_a_reader_whose_socket_takes_little_at_a_time() -> None:
    """The queue has room for 16 urgent messages; with Zenoh's wait of 1 ms many of these 1000 are lost."""
    endpoint, _ = free_endpoints()
    heard: list[bytes] = []
    with (
        open_router(configure("router", ZenohOptions(listen=[f"{endpoint}#so_sndbuf=4096"])), endpoint) as router,
        a_client(f"{endpoint}#so_rcvbuf=4096") as reader,
        reader.declare_subscriber("a/b", lambda sample: heard.append(sample.payload.to_bytes())),
    ):
        settle(reader)
        publisher = router.declare_publisher("a/b", express=True, congestion_control=zenoh.CongestionControl.DROP)
        for number in range(1000):
            publisher.put(b"%4d" % number * 1000)
        router.put("a/b", b"last", congestion_control=zenoh.CongestionControl.BLOCK)
        assert soon(lambda: b"last" in heard)
    assert heard == [*(b"%4d" % number * 1000 for number in range(1000)), b"last"]
