"""Access control of the page: a token in its address, and headers that let no other site show or use it.

On loopback, too: other users of the host and programs in its browser reach it there.
"""

import contextlib
import ipaddress
import re
import secrets
import socket
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, cast
from urllib.parse import urlencode

from bokeh.server.auth_provider import AuthProvider
from tornado.httputil import HTTPHeaders, HTTPServerRequest
from tornado.routing import AnyMatches, HostMatches, PathMatches, Router, Rule, RuleRouter
from tornado.web import Application, ErrorHandler, HTTPError, OutputTransform, RequestHandler

LOOPBACK: Final = "127.0.0.1"
_LOOPBACK_NAMES: Final = (LOOPBACK, "localhost")
_TOKEN_BYTES: Final = 24
_FORBIDDEN: Final = 403
_PATHS: Final = r"/(?:ws|drive|report|picture|static/.*)?"
_POLICY: Final = (
    "default-src 'none'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self' {sockets}; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'none'"
)
"""Bokeh's pages consist of inline scripts, and its callbacks are compiled from text."""
_HEADERS: Final = {
    "X-Frame-Options": "DENY",  # as frame-ancestors, for browsers that do not know it
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",  # the address holds the token
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}
_STATIC: Final = "/static/"
"""What lies there is Bokeh's, has no secrets, and may stay in the browser."""


@dataclass(frozen=True)
class Access:
    """Address of the page, host names under which it may be opened, and the required token."""

    address: str
    hosts: tuple[str, ...]
    token: str

    def origins(self, port: int) -> list[str]:
        """Return the origins allowed to open a WebSocket: the page's own."""
        return [f"{_bracketed(host)}:{port}" for host in self.hosts]

    def guard(self, server: Application) -> Router:
        """Return ``server`` for requests to the page's own hosts and paths; all others are refused (403).

        The Host of a request tells a page of ours from a name of somebody else that was made to point here (DNS
        rebinding). ``autoload.js`` and ``metadata`` would give any site's script a session.
        """
        hosts = "|".join(re.escape(_bracketed(host)) for host in self.hosts)
        own_host = HostMatches(re.compile(rf"(?:{hosts})\Z", re.IGNORECASE))
        own_paths = RuleRouter([Rule(PathMatches(_PATHS), server)])
        refused = Application(default_handler_class=ErrorHandler, default_handler_args={"status_code": _FORBIDDEN})
        for each in (server, refused):
            each.add_transform(_Hardened)
        return RuleRouter([Rule(own_host, own_paths), Rule(AnyMatches(), refused)])

    def url(self, port: int) -> str:
        """Return the URL of the page."""
        return f"http://{_bracketed(self.hosts[0])}:{port}/?{urlencode({'token': self.token})}"


class _Hardened(OutputTransform):
    """Adds the headers that keep other sites out to every response."""

    def __init__(self, request: HTTPServerRequest) -> None:
        self._headers = _HEADERS | {"Content-Security-Policy": _POLICY.format(sockets=f"ws://{request.host}")}
        if not request.path.startswith(_STATIC):
            self._headers["Cache-Control"] = "no-store"

    def transform_first_chunk(
        self, status_code: int, headers: HTTPHeaders, chunk: bytes, finishing: bool
    ) -> tuple[int, HTTPHeaders, bytes]:
        headers.update(self._headers)
        return super().transform_first_chunk(status_code, headers, chunk, finishing)


def access_to(address: str, names: Sequence[str] = ()) -> Access:
    """Return the access to a page at ``address``; ``names`` are further host names that lead to it.

    Raises `ValueError` unless it is an address of this host.
    """
    found = {entry[4][0] for entry in _resolve(address)}
    if all(ipaddress.ip_address(str(ip).partition("%")[0]).is_loopback for ip in found):
        hosts: tuple[str, ...] = (address, *_LOOPBACK_NAMES, *names)
    elif any(ipaddress.ip_address(str(ip).partition("%")[0]).is_unspecified for ip in found):
        hosts = (*names, *_own_names(), *_LOOPBACK_NAMES)
    else:
        hosts = (*names, address)
    return Access(address, tuple(dict.fromkeys(hosts)), secrets.token_urlsafe(_TOKEN_BYTES))


class TokenAuth(AuthProvider):
    """Refuses (403) every page and connection without the token; a cookie carries it to the WebSocket.

    Bokeh awaits the check in `prepare`, before it accepts a WebSocket.
    """

    def __init__(self, token: str) -> None:
        self._token = token
        super().__init__()

    @property
    def get_user(self) -> Any:
        """Return None: `get_user_async` decides."""
        return None

    @property
    def get_user_async(self) -> Any:
        """Return the check of a request's token."""

        async def decide(handler: RequestHandler) -> str:
            port = handler.request.host.rpartition(":")[2]
            cookie = f"tis_view_{port}"  # cookies are shared by all ports of a host
            given = handler.get_query_argument("token", None)
            for candidate in (given, handler.get_cookie(cookie)):
                if candidate is not None and secrets.compare_digest(candidate.encode(), self._token.encode()):
                    if candidate is given:
                        handler.set_cookie(cookie, self._token, httponly=True, samesite="Strict")
                    return "token"
            raise HTTPError(_FORBIDDEN, reason="the token is missing: use the address that tis printed")

        return decide

    @property
    def login_url(self) -> Any:
        """Return a placeholder: there is no login, a request without the token is refused."""
        return "/"

    get_login_url: Any = None
    login_handler: Any = None
    logout_url: Any = None
    logout_handler: Any = None


def _resolve(address: str) -> Sequence[Any]:
    try:
        return cast("Sequence[Any]", socket.getaddrinfo(address, None, type=socket.SOCK_STREAM))
    except OSError as error:
        raise ValueError(str(error.strerror or error)) from None


def _own_names() -> list[str]:
    """Return the names of this host for others: the address it sends from, its name, its other addresses."""
    names = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # a documentation address (RFC 5737): no packet is sent
            names.append(str(probe.getsockname()[0]))
        except OSError:
            pass
    name = socket.gethostname()
    names.append(name)
    with contextlib.suppress(OSError):
        names += [str(entry[4][0]) for entry in socket.getaddrinfo(name, None, socket.AF_INET)]
    return list(dict.fromkeys(names))


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host
