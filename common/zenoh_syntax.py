"""Syntax of Zenoh, checked without it: endpoints PROTOCOL/ADDRESS[?metadata][#config], and key expressions."""

import re
from collections.abc import Iterable, Mapping, Sequence
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

    Unreachable hosts and missing protocols show only when a session opens. Oracle: Zenoh, test_zenoh_syntax.
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

    A name is one of this host only if it is ``localhost``. Oracle: literals, test_zenoh_syntax.
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


_WHOLE_CHUNKS: Final = ("*", "**")
_PART: Final = "$*"
_SPECIAL: Final = frozenset("*$#?")


def key_expression_fault(text: str) -> str | None:
    """Return the rule that a key expression breaks, None for one that Zenoh accepts and makes canonical.

    ``$*$*``, a synonym of ``$*``, is refused because it can crash Zenoh 1.10. Oracle: Zenoh, test_zenoh_syntax.
    """
    chunks = text.split("/")
    if not all(chunks):
        return "must be a Zenoh key expression: no empty chunk, and no slash at the beginning or end"
    if any(_is_wrong(chunk) for chunk in chunks):
        return "must be a Zenoh key expression: *, ** as whole chunks, $* within one, and no other *, $, # or ?"
    return None


def _is_wrong(chunk: str) -> bool:
    if chunk in _WHOLE_CHUNKS:
        return False
    parts = chunk.split(_PART)
    return "" in parts[1:-1] or any(_SPECIAL.intersection(part) for part in parts)


def key_matches(expression: str, key: str) -> bool:
    """Tell whether a key expression holds a key that has no wildcard. Oracle: Zenoh, test_zenoh_syntax."""
    if expression == key:
        return True
    if _WHOLE_CHUNKS[0] not in expression:
        return False
    return _chunks_match(expression.split("/"), key.split("/"))


def _chunks_match(expression: list[str], key: list[str]) -> bool:
    if not expression:
        return not key
    first, rest = expression[0], expression[1:]
    if first == _WHOLE_CHUNKS[1]:
        hidden = next((i for i, chunk in enumerate(key) if chunk.startswith("@")), len(key))
        return any(_chunks_match(rest, key[n:]) for n in range(hidden + 1))
    if not key:
        return False
    if first == _WHOLE_CHUNKS[0]:
        return not key[0].startswith("@") and _chunks_match(rest, key[1:])
    pattern = ".*".join(map(re.escape, first.split(_PART)))
    return re.fullmatch(pattern, key[0]) is not None and _chunks_match(rest, key[1:])


class KeySet:
    """Keys by name, and those that an expression with wildcards holds. Oracle: Zenoh, test_zenoh_syntax."""

    def __init__(self, keys: Iterable[str] = ()) -> None:
        every = frozenset(keys)
        self._plain: Final = frozenset(key for key in every if "*" not in key)
        self._expressions: Final = tuple(sorted(every - self._plain))

    def __contains__(self, key: str) -> bool:
        if key in self._plain:
            return True
        # netem asks for each packet: no generator for nothing
        return bool(self._expressions) and any(key_matches(expression, key) for expression in self._expressions)

    def __bool__(self) -> bool:
        return bool(self._plain or self._expressions)


NO_KEYS: Final = KeySet()
