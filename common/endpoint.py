"""Syntax check of Zenoh endpoints, PROTOCOL/ADDRESS[?metadata][#config], before they are used."""

import re
from collections.abc import Mapping, Sequence
from ipaddress import ip_address
from typing import Final

from tis.common.errors import Fault

ENDPOINT_RULE: Final = "must be PROTOCOL/ADDRESS, like tcp/127.0.0.1:7447"
PORT_RULE: Final = "must end with a port, 0 to 65535, like tcp/127.0.0.1:7447"

_TLS: Final = ("tls", "quic")
_ON_THIS_HOST: Final = ("unixsock-stream", "unixpipe", "vsock", "serial")
_FORM: Final = re.compile(r"([a-z0-9_+-]+)/([^\s?#]+)(\?[^\s#]*)?(#\S*)?")
_WITH_PORT: Final = frozenset(("tcp", "udp", "tls", "quic", "ws"))
_MAX_PORT: Final = 65_535


def endpoint_fault(endpoint: str) -> str | None:
    """Return the rule that an endpoint breaks, None for one that Zenoh accepts.

    Unreachable hosts and missing protocols show only when a session opens. Oracle: Zenoh, test_endpoint.
    """
    form = _FORM.fullmatch(endpoint)
    if form is None:
        return ENDPOINT_RULE
    protocol, address = form[1], form[2]
    if protocol not in _WITH_PORT:
        return None
    host, colon, port = address.rpartition(":")
    has_port = host and colon and port.isascii() and port.isdecimal() and int(port) <= _MAX_PORT
    return None if has_port else PORT_RULE


def is_tls(endpoint: str) -> bool:
    """Tell whether an endpoint is encrypted."""
    return endpoint.partition("/")[0] in _TLS


def port_of(endpoint: str) -> int | None:
    """Return an endpoint's port, None where its protocol has none."""
    form = _FORM.fullmatch(endpoint)
    port = "" if form is None or form[1] not in _WITH_PORT else form[2].rpartition(":")[2]
    return int(port) if port.isdecimal() else None


def is_local(endpoint: str) -> bool:
    """Tell whether only programs on this host reach a listener on this endpoint.

    A name is one of this host only if it is ``localhost``. Oracle: literals, test_endpoint.
    """
    form = _FORM.fullmatch(endpoint)
    if form is None:
        return False
    if form[1] in _ON_THIS_HOST:
        return True
    host = form[2].rpartition(":")[0].removeprefix("[").removesuffix("]")
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def endpoint_faults(where: str, given: Mapping[str, Sequence[str]]) -> list[Fault]:
    """Return the faults of the endpoints that were given, by option."""
    return [
        Fault(where, option, rule, endpoint)
        for option, endpoints in given.items()
        for endpoint in endpoints
        if (rule := endpoint_fault(endpoint)) is not None
    ]
