"""The door of driving pages, asked of a server that listens: rights, hostile messages, floods, two drivers."""

import asyncio
import json
from collections.abc import Callable, Coroutine
from typing import Any

import pytest
from bokeh.application import Application
from bokeh.application.handlers import FunctionHandler
from tornado.httpclient import HTTPClientError, HTTPRequest
from tornado.ioloop import IOLoop
from tornado.websocket import WebSocketClientConnection, websocket_connect

from tests.deploy.view.test_drive import _Door, _hub
from tis.deploy.view.access import Access
from tis.deploy.view.drive import OTHER_DRIVES
from tis.deploy.view.drive_socket import TOO_MANY, DriveSockets
from tis.deploy.view.server import listen

pytestmark = pytest.mark.live

_TIME_OUT_S = 30
_MOVE = json.dumps({"moved_mm": [1.0, 2.0, 3.0]})


def _served(
    ask: Callable[[str, _Door, DriveSockets], Coroutine[Any, Any, None]], access: Access | None = None
) -> _Door:
    """Let ``ask`` try things on a server; return the door that its moves went through."""
    door, admitted = _Door(), access or Access("127.0.0.1", ("127.0.0.1",), "secret-token")
    sockets = DriveSockets(_hub(door))

    async def main() -> None:
        empty = Application(FunctionHandler(lambda _: None))
        server, port = listen(empty, admitted, 0, IOLoop.current(), [sockets.route])
        server.start()
        try:
            await asyncio.wait_for(ask(f"127.0.0.1:{port}", door, sockets), _TIME_OUT_S)
        finally:
            server.stop(wait=False)
            server.unlisten()

    asyncio.run(main())
    return door


async def _open(place: str, query: str = "?token=secret-token", **headers: str) -> WebSocketClientConnection:
    return await websocket_connect(HTTPRequest(f"ws://{place}/drive{query}", headers=headers))


async def _answer(page: WebSocketClientConnection) -> dict[str, Any]:
    message = await page.read_message()
    assert isinstance(message, str)
    found: dict[str, Any] = json.loads(message)
    return found


async def _close(page: WebSocketClientConnection) -> None:
    page.close()
    while await page.read_message() is not None:  # until the server has closed it, too
        pass


async def _until(condition: Callable[[], bool]) -> None:
    """Let the server work until something holds."""
    while not condition():
        await asyncio.sleep(0)


def test_bad_messages_are_answered_in_words_and_the_next_good_one_moves() -> None:
    async def ask(place: str, door: _Door, _: DriveSockets) -> None:
        page = await _open(place, Origin=f"http://{place}")
        for message, field in (
            ('{"moved_mm": [NaN, 0, 0]}', "moved_mm.0: "),
            ('{"moved_mm": [0, 0, 0], "speed": 9}', "speed: "),
            ("not json", "message: "),
            ("x" * 1000, "message: must have at most 400 characters"),
        ):
            await page.write_message(message)
            assert (await _answer(page))["refused"].startswith(field)
        await page.write_message(b"\xff\xfe", binary=True)
        assert (await _answer(page))["refused"].startswith("message: ")
        assert door.sent == []
        await page.write_message(_MOVE)
        assert await _answer(page) == {"refused": ""}
        await _close(page)

    assert [pose.position_m.y for pose in _served(ask).sent] == [0.004]


def test_a_request_is_answered_in_words_to_the_page_that_asked() -> None:
    async def ask(place: str, door: _Door, _: DriveSockets) -> None:
        page = await _open(place)
        await page.write_message('{"ask": "delay", "way": "forward", "value": 50}')
        assert await _answer(page) == {"asked": "delay", "answer": "done: forward delay.delay_ms=50"}
        await page.write_message('{"ask": "delay", "value": 1e9}')
        assert "value of delay must be a number from 0 to 10000" in (await _answer(page))["refused"]
        assert door.sent == []
        await _close(page)

    _served(ask)


def test_a_flood_is_thinned_then_told_and_at_last_shown_out() -> None:
    async def ask(place: str, _: _Door, sockets: DriveSockets) -> None:
        page, other = await _open(place), await _open(place)
        for _n in range(1300):
            await page.write_message(_MOVE)
        assert await _answer(page) == {"refused": TOO_MANY}
        while await page.read_message() is not None:
            pass
        assert (page.close_code, page.close_reason) == (1008, TOO_MANY)
        page.close()
        await _until(lambda: len(sockets.pages) == 1)
        # the seat is free at once, and the others are served
        await other.write_message(_MOVE)
        await _until(lambda: sockets.hub.seat.driver in sockets.pages)
        await _close(other)

    assert 50 <= len(_served(ask).sent) < 400


def test_a_second_driver_waits_until_the_first_has_closed_its_page() -> None:
    async def ask(place: str, door: _Door, sockets: DriveSockets) -> None:
        one, two = await _open(place), await _open(place)
        await one.write_message(_MOVE)
        await _until(lambda: len(door.sent) == 1)
        await two.write_message(_MOVE)
        assert await _answer(two) == {"refused": OTHER_DRIVES, "lost": True}
        sockets.send()
        assert [(await _answer(page))["driver"] for page in (one, two)] == ["you", "other"]
        await _close(one)
        await _until(lambda: sockets.hub.seat.driver is None)
        assert sockets.hub.seat.hand_mm == (1.0, 2.0, 3.0), "the hand holds"
        sockets.send()
        assert (await _answer(two))["driver"] == "nobody"
        await two.write_message(_MOVE)
        assert await _answer(two) == {"refused": ""}
        assert sockets.hub.seat.hand_mm == (2.0, 4.0, 6.0), "it goes on from where it was left"
        await _close(two)

    _served(ask)


def test_without_the_token_or_from_another_site_nobody_drives() -> None:
    access = Access("127.0.0.1", ("127.0.0.1",), "secret-token")

    async def ask(place: str, _: _Door, __: DriveSockets) -> None:
        for query, headers in (
            ("", {}),
            ("?token=guessed", {}),
            ("?token=secret-token", {"Origin": "http://evil.example"}),
            ("?token=secret-token", {"Host": "evil.example"}),
        ):
            with pytest.raises(HTTPClientError, match="403"):
                await _open(place, query, **headers)
        page = await _open(place, "?token=secret-token", Origin=f"http://{place}")
        await page.write_message('{"moved_mm": []}')
        assert "moved_mm" in (await _answer(page))["refused"]
        await _close(page)

    assert _served(ask, access).sent == []


def test_no_more_pages_than_the_server_can_serve() -> None:
    async def ask(place: str, _: _Door, sockets: DriveSockets) -> None:
        pages = [await _open(place) for _ in range(32)]
        await _until(lambda: len(sockets.pages) == 32)
        late = await _open(place)
        assert await late.read_message() is None
        assert (late.close_code, late.close_reason) == (1013, "32 pages are open")
        late.close()
        await _close(pages.pop())
        await _until(lambda: len(sockets.pages) == 31)
        for page in pages:
            await _close(page)

    _served(ask)
