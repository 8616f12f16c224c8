import pytest
import zenoh

from tis.common.zenoh_syntax import ENDPOINT_RULE, PORT_RULE, endpoint_fault, endpoint_faults, is_local, is_tls


@pytest.mark.parametrize(
    "endpoint",
    [
        "tcp/127.0.0.1:7447",
        "tcp/[::1]:7447",
        "tls/surgeon.example.org:7447#root_ca_certificate=ca.pem",
        "udp/localhost:0",
        "tcp/localhost:7447?prio=1-3",
        "unixsock-stream/tis.sock",
    ],
)
def test_what_zenoh_takes_has_no_fault(endpoint: str) -> None:
    assert endpoint_fault(endpoint) is None
    zenoh.Config().insert_json5("connect/endpoints", f'["{endpoint}"]')


@pytest.mark.parametrize("endpoint", ["", "foo", "/127.0.0.1:7447", "tcp/", "tcp/a b:1", "TCP/127.0.0.1:7447"])
def test_what_has_another_form(endpoint: str) -> None:
    assert endpoint_fault(endpoint) == ENDPOINT_RULE


@pytest.mark.parametrize("endpoint", ["tcp/127.0.0.1", "tcp/127.0.0.1:", "tcp/:7447", "tcp/1.2.3.4:65536", "udp/x:y"])
def test_where_a_port_is_wanted(endpoint: str) -> None:
    assert endpoint_fault(endpoint) == PORT_RULE


def test_every_fault_is_named_by_its_option() -> None:
    given = {"--west": ["foo", "tcp/127.0.0.1:7447"], "--east": ["tcp/127.0.0.1"]}
    assert [str(fault) for fault in endpoint_faults("netem", given)] == [
        f"netem: --west: {ENDPOINT_RULE} (got 'foo')",
        f"netem: --east: {PORT_RULE} (got 'tcp/127.0.0.1')",
    ]


@pytest.mark.parametrize(
    ("endpoint", "local"),
    [
        ("tcp/127.0.0.1:7447", True),
        ("tcp/127.8.9.1:7447", True),
        ("tls/[::1]:7447", True),
        ("udp/localhost:0", True),
        ("unixsock-stream/tis.sock", True),
        ("tcp/0.0.0.0:7447", False),
        ("tcp/[::]:7447", False),
        ("tcp/192.168.1.5:7447", False),
        ("tcp/localhost.example.org:7447", False),
        ("tcp/[::ffff:10.0.0.1]:7447", False),
        ("foo", False),
    ],
)
def test_only_loopback_and_sockets_of_this_host_are_local(endpoint: str, local: bool) -> None:
    assert is_local(endpoint) == local


def test_tls_and_quic_are_encrypted() -> None:
    assert [is_tls(f"{protocol}/127.0.0.1:1") for protocol in ("tls", "quic", "tcp", "udp", "ws")] == [
        True, True, False, False, False,
    ]  # fmt: skip
