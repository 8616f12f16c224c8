"""A renewed certificate of netem's in listeners that run; in a whole run: tests/system/test_living_certificates."""

import json
import queue
import socket
import ssl
import time
from pathlib import Path

import pytest
import zenoh

from tis.common.errors import PeerError
from tis.common.runtime.credentials import credentials
from tis.common.runtime.ports import free_endpoints
from tis.common.runtime.zenoh_session import ZenohOptions, configure, open_router
from tis.common.scenario.security import Mtls
from tis.common.zenoh_syntax import port_of
from tis.deploy.tools.certificates import issue, new_authority
from tis.netem.bridge.renewal import N_SPARES, RenewedListeners, with_spares


def test_only_a_tls_endpoint_with_a_port_has_spares() -> None:
    assert with_spares("tcp/127.0.0.1:7447") == ["tcp/127.0.0.1:7447"]
    assert with_spares("tls/127.0.0.1:0") == ["tls/127.0.0.1:0"]
    first, *spares = with_spares("tls/127.0.0.1:7447#iface=lo")
    assert first == "tls/127.0.0.1:7447#iface=lo"
    assert len(spares) == N_SPARES
    assert all(one.startswith(f"{first};exit_on_failure=false;") for one in spares)


def _serial(folder: Path, port: int) -> str:
    context = ssl.create_default_context(cafile=folder / "ca.pem")
    context.load_cert_chain(folder / "cert.pem", folder / "key.pem")
    with (
        socket.create_connection(("127.0.0.1", port), timeout=10) as plain,
        context.wrap_socket(plain, server_hostname="127.0.0.1") as secured,
    ):
        found = secured.getpeercert()
        assert found is not None
        return str(found["serialNumber"])


@pytest.mark.live
def test_listeners_take_renewed_certificates_open_connections_go_on_and_it_closes_at_once(tmp_path: Path) -> None:
    endpoint = free_endpoints()[0].replace("tcp/", "tls/")
    port = port_of(endpoint)
    assert port
    new_authority(tmp_path)
    for name in ("netem", "surgeon"):
        issue(tmp_path, name)
    security, told, heard = Mtls(kind="mtls", folder=str(tmp_path)), queue.Queue[str](), queue.Queue[bytes]()
    own = credentials(security, "netem")
    config = configure("router", ZenohOptions(listen=[endpoint], credentials=own))
    config.insert_json5("listen/endpoints", json.dumps(with_spares(endpoint)))
    config.insert_json5("listen/timeout_ms", "2000")
    client = configure("client", ZenohOptions(connect=[endpoint], credentials=credentials(security, "surgeon")))
    router = open_router(config, endpoint)
    listeners = RenewedListeners(tmp_path / "netem", [endpoint], told.put)
    try:
        router.declare_subscriber("a", lambda sample: heard.put(sample.payload.to_bytes()))
        with zenoh.open(client) as session:
            for number in range(N_SPARES):
                before = _serial(tmp_path / "surgeon", port)
                issue(tmp_path, "netem")
                assert "open connections went on" in told.get(timeout=30)
                assert _serial(tmp_path / "surgeon", port) != before
                session.put("a", str(number))
                assert heard.get(timeout=30) == str(number).encode()
            issue(tmp_path, "netem")
            assert "at its next start" in told.get(timeout=30)
            with pytest.raises(PeerError, match="in use or not of this host"):
                open_router(config, endpoint)
    finally:
        listeners.close()
        begun_s = time.monotonic()
        router.close()  # type: ignore[no-untyped-call]
    assert time.monotonic() - begun_s < 9, "Zenoh gives up to wait for a spare after 10 s"
