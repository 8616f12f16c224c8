import pytest
import zenoh
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.zenoh_syntax import (
    ENDPOINT_RULE,
    PORT_RULE,
    KeySet,
    endpoint_fault,
    endpoint_faults,
    is_local,
    is_tls,
    key_expression_fault,
    key_matches,
)


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


def _zenoh_takes(text: str) -> bool:
    try:
        zenoh.KeyExpr.autocanonize(text)
    except zenoh.ZError:
        return False
    return True


@given(st.text("ab/*$#?@", max_size=8).filter(lambda text: "$*$*" not in text))
@settings(max_examples=400)
def test_what_zenoh_takes_has_no_fault_and_nothing_else(text: str) -> None:
    assert (key_expression_fault(text) is None) == _zenoh_takes(text)


def test_what_zenoh_may_crash_of_is_refused() -> None:
    assert key_expression_fault("a$*$*") is not None
    assert key_expression_fault("a$*b$*") is None


def test_the_rule_is_named() -> None:
    assert "no slash at the beginning" in (key_expression_fault("/demo/alarm") or "")
    assert "no other *, $, # or ?" in (key_expression_fault("demo/a*") or "")


CHUNK = st.sampled_from(["a", "b", "ab", "aab", "@x"])
PATTERN = st.sampled_from(["a", "*", "**", "a$*", "$*b", "$*a$*"])


@given(st.lists(PATTERN, min_size=1, max_size=4), st.lists(CHUNK, min_size=1, max_size=4))
def test_a_key_matches_as_zenoh_says(pattern: list[str], chunks: list[str]) -> None:
    expression, key = "/".join(pattern), "/".join(chunks)
    if key_expression_fault(expression) is None:
        expected = zenoh.KeyExpr.autocanonize(expression).includes(zenoh.KeyExpr(key))
        assert key_matches(expression, key) == expected


def test_a_set_holds_keys_and_expressions() -> None:
    keys = KeySet(["tis/PSM2/servo_cp", "0/device/left/*/*"])
    assert "tis/PSM2/servo_cp" in keys
    assert "0/device/left/geometry_msgs::msg::dds_::PoseStamped_/RIHS01_ab" in keys
    assert "0/device/right/x/y" not in keys
    assert keys
    assert not KeySet()
