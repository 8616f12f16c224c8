"""Who may open the page, asked of a server that listens, with Tornado's own client."""

import asyncio
import re
from collections.abc import Callable, Coroutine
from typing import Any

import pytest
from bokeh.application import Application
from bokeh.application.handlers import FunctionHandler
from bokeh.models.widgets.markups import Div
from bokeh.util.token import generate_session_id
from tornado.httpclient import AsyncHTTPClient, HTTPRequest, HTTPResponse
from tornado.ioloop import IOLoop
from tornado.websocket import websocket_connect

from tis.deploy.view.access import Access, access_to
from tis.deploy.view.server import ViewOptions, listen

pytestmark = pytest.mark.live

_TIME_OUT_S = 20
_PAGE = Access("127.0.0.1", ("127.0.0.1", "localhost"), "secret-token")
_OPEN = "?token=secret-token"


def test_loopback_is_the_default() -> None:
    access = access_to(ViewOptions("w", "e").address)
    assert access.origins(81) == ["127.0.0.1:81", "localhost:81"]
    assert access.url(81) == f"http://127.0.0.1:81/?token={access.token}"


@pytest.mark.parametrize("address", ["localhost", "127.0.0.5"])
def test_the_given_name_of_loopback_leads_to_the_page(address: str) -> None:
    access = access_to(address)
    assert access.origins(81)[0] == f"{address}:81"
    assert access.url(81).startswith(f"http://{address}:81/")


@pytest.mark.parametrize("address", ["127.0.0.1", "0.0.0.0", "::"])
def test_there_is_a_token_and_no_wildcard(address: str) -> None:
    one, two = access_to(address, ["lab.example"]), access_to(address)
    assert one.token
    assert len(one.token) >= 32
    assert one.token != two.token
    assert "lab.example:81" in one.origins(81)
    assert not any("*" in origin for origin in one.origins(81))
    assert one.url(81) == f"http://{one.hosts[0]}:81/?token={one.token}"


def test_an_address_that_is_none_is_refused() -> None:
    with pytest.raises(ValueError, match=r".+"):
        access_to("no such host.invalid")


def test_an_ipv6_address_is_bracketed() -> None:
    assert Access("::1", ("::1",), "x").url(81) == "http://[::1]:81/?token=x"


def _served(access: Access, ask: Callable[[str], Coroutine[Any, Any, None]]) -> None:
    """Serve a page that says hello, and let ``ask`` try things on it."""

    async def main() -> None:
        hello = Application(FunctionHandler(lambda doc: doc.add_root(Div(text="hello"))))
        server, port = listen(hello, access, 0, IOLoop.current())
        server.start()
        try:
            await asyncio.wait_for(ask(f"127.0.0.1:{port}"), _TIME_OUT_S)
        finally:
            server.stop(wait=False)
            server.unlisten()

    asyncio.run(main())


async def _fetch(url: str, **headers: str) -> HTTPResponse:
    client = AsyncHTTPClient(force_instance=True)
    try:
        request = HTTPRequest(url, headers=headers, follow_redirects=False)
        return await client.fetch(request, raise_error=False)
    finally:
        client.close()


async def _code(url: str, **headers: str) -> int:
    return (await _fetch(url, **headers)).code


async def _session_token(url: str) -> tuple[str, str]:
    """Return what the page's script would connect with, and the page's cookie."""
    response = await _fetch(url)
    found = re.search(r'"token":"([^"]+)"', response.body.decode())
    assert found is not None
    return found[1], response.headers.get("Set-Cookie", "").partition(";")[0]


async def _upgrade(place: str, token: str, **headers: str) -> int:
    """Return the code with which a WebSocket is refused."""
    asked = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Protocol": f"bokeh, {token}"}
    asked |= {"Sec-WebSocket-Version": "13", "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ=="}
    return await _code(f"http://{place}/ws", **asked, **headers)


async def _connect(place: str, token: str, **headers: str) -> str:
    """Return what the server says first on a WebSocket."""
    request = HTTPRequest(f"ws://{place}/ws", headers=headers)
    connection = await websocket_connect(request, subprotocols=["bokeh", token])
    first = message = await connection.read_message()
    connection.close()
    while message is not None:  # until the server has closed it, too
        message = await connection.read_message()
    return str(first)


def test_only_the_pages_own_origin_may_connect() -> None:
    async def ask(place: str) -> None:
        token, cookie = await _session_token(f"http://{place}/{_OPEN}")
        assert "ACK" in await _connect(place, token, Origin=f"http://{place}", Cookie=cookie)
        port = place.partition(":")[2]
        for foreign in ("http://evil.example", f"http://evil.example:{port}", "http://127.0.0.1:1", "null"):
            assert await _upgrade(place, token, Origin=foreign, Cookie=cookie) == 403, foreign

    _served(_PAGE, ask)


def test_a_session_that_no_page_was_given_is_refused() -> None:
    async def ask(place: str) -> None:
        forged = generate_session_id(signed=True, secret_key=b"another key")
        assert await _code(f"http://{place}/{_OPEN}&bokeh-session-id={forged}") == 403
        token, cookie = await _session_token(f"http://{place}/{_OPEN}")
        told = await _connect(place, token[:-4] + "AAAA", Origin=f"http://{place}", Cookie=cookie)
        assert told == "None"  # closed, without a word

    _served(_PAGE, ask)


def test_without_the_token_there_is_nothing_to_be_had() -> None:
    async def ask(place: str) -> None:
        for path in ("/", "/?token=", "/?token=wrong", "/metadata", "/autoload.js", "/ws"):
            assert await _code(f"http://{place}{path}") == 403, path
        assert await _code(f"http://{place}/?token=secret-token") == 200
        port = place.partition(":")[2]
        assert await _code(f"http://{place}/", Cookie=f"tis_view_{port}=wrong") == 403
        session, cookie = await _session_token(f"http://{place}/?token=secret-token")
        assert cookie == f"tis_view_{port}=secret-token"
        assert await _upgrade(place, session, Origin=f"http://{place}") == 403
        assert "ACK" in await _connect(place, session, Origin=f"http://{place}", Cookie=cookie)

    _served(_PAGE, ask)


def test_under_another_hosts_name_nothing_is_answered() -> None:
    """A name of somebody else may be made to point here (DNS rebinding): the browser then calls it the page's own."""

    async def ask(place: str) -> None:
        port = place.partition(":")[2]
        token, cookie = await _session_token(f"http://{place}/{_OPEN}")
        for host in (f"evil.example:{port}", "evil.example", f"127.0.0.1.evil.example:{port}", f"x127.0.0.1:{port}"):
            for path in ("", "static/js/bokeh.min.js", "report", "metadata"):
                assert await _code(f"http://{place}/{path}{_OPEN}", Host=host) == 403, (host, path)
            asked = {"Host": host, "Origin": f"http://{host}", "Cookie": cookie}
            assert await _upgrade(place, token, **asked) == 403, host
        for host in (f"localhost:{port}", f"LOCALHOST:{port}", f"127.0.0.1:{port}"):
            assert await _code(f"http://{place}/{_OPEN}", Host=host) == 200, host


def test_no_other_site_may_frame_the_page_or_read_it() -> None:
    async def ask(place: str) -> None:
        for path in (_OPEN, "", "static/js/bokeh.min.js", "metadata"):  # whatever the answer is
            headers = (await _fetch(f"http://{place}/{path}")).headers
            policy = headers["Content-Security-Policy"]
            assert "frame-ancestors 'none'" in policy, path
            assert f"connect-src 'self' ws://{place};" in policy, path
            assert headers["X-Frame-Options"] == "DENY", path
            assert headers["Referrer-Policy"] == "no-referrer", path  # the address holds the token
            # the page is of one run, Bokeh's scripts serve the next one, too
            assert (headers.get("Cache-Control") == "no-store") == (not path.startswith("static")), path

    _served(_PAGE, ask)

    _served(_PAGE, ask)


def test_no_other_site_gets_a_session_by_a_script() -> None:
    async def ask(place: str) -> None:
        for path in ("autoload.js?bokeh-autoload-element=1", "autoload.js", "metadata", "static/../autoload.js"):
            answer = await _fetch(f"http://{place}/{path}")
            assert (answer.code, b"token" in answer.body) == (403, False), path

    _served(_PAGE, ask)
