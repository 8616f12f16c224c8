import pytest
import zenoh

from common.endpoint import ENDPOINT_RULE, PORT_RULE, endpoint_fault, endpoint_faults


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
