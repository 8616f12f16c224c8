"""The picture goes to those who may open the page, the newest one, and to each one at a time."""

import asyncio
import json
import time
from collections.abc import Callable, Coroutine
from types import SimpleNamespace
from typing import Any

import pytest
from bokeh.application import Application
from tornado.httpclient import AsyncHTTPClient, HTTPResponse
from tornado.ioloop import IOLoop
from zenoh import ZBytes

from tis.common.scenario.control import EmulatorState
from tis.common.scenario.security import Password
from tis.common.scenario.sight import SightPart
from tis.common.units import NS_PER_MS
from tis.deploy.view.access import Access
from tis.deploy.view.picture_process import _sight as sight_asked
from tis.deploy.view.pictures import CAME, LATE, SAYS, PictureDoor
from tis.deploy.view.server import listen
from tis.netem.bridge.access import access_control

pytestmark = pytest.mark.live

_DECODES = """
import json, sys
sys.stdin.readline()
for number, _ in enumerate(sys.stdin, 1):
    said = {"number": number, "captured_ns": 5, "n_bytes": 3}
    print(json.dumps(said), flush=True)
    print(f"{number:03d}", end="", flush=True)
"""
_HAS_NONE = 'import sys; sys.stdin.readline(); print(\'{"number": 0, "needs": "av", "n_bytes": 0}\')'
_Get = Callable[[str], Coroutine[Any, Any, HTTPResponse]]


def _served(program: str, ask: Callable[[_Get, PictureDoor], Coroutine[Any, Any, None]]) -> None:
    async def main() -> None:
        door = PictureDoor({}, lambda: 40 * NS_PER_MS - time.monotonic_ns(), ("-c", program))
        access = Access("127.0.0.1", ("127.0.0.1",), "secret")
        server, port = listen(Application(), access, 0, IOLoop.current(), [door.route])
        server.start()

        async def get(query: str) -> HTTPResponse:
            return await AsyncHTTPClient().fetch(f"http://127.0.0.1:{port}/picture{query}", raise_error=False)

        try:
            await ask(get, door)
        finally:
            server.stop(wait=False)
            server.unlisten()
            door.close()

    asyncio.run(main())


def test_a_page_gets_the_newest_picture_and_its_age_and_nothing_is_decoded_for_nobody() -> None:
    async def ask(get: _Get, door: PictureDoor) -> None:
        assert [(await get(query)).code for query in ("", "?token=guess&after=0")] == [403, 403]
        assert door.newest is None
        first = await get("?token=secret&after=0")
        assert (first.code, first.body, first.headers["Content-Type"]) == (200, b"001", "image/jpeg")
        assert json.loads(first.headers[SAYS]) == {"number": 1, "captured_ns": 5, "age_ms": 40.0}
        assert (await get("?token=secret&after=0")).body == b"001"  # another page: it is there already
        both = await asyncio.gather(*(get("?token=secret&after=1") for _ in range(2)))
        assert [one.body for one in both] == [b"002"] * 2, "one picture for all who wait"
        assert (await get("?token=secret&after=x")).code == 400

    _served(_DECODES, ask)


def test_a_run_without_a_picture_says_so_at_once() -> None:
    async def ask(get: _Get, door: PictureDoor) -> None:
        answer = await get("?token=secret&after=0")
        assert (answer.code, json.loads(answer.headers[SAYS])) == (204, {"needs": "av"})
        assert door.is_blind

    _served(_HAS_NONE, ask)


_LOOKS_IN_VAIN = """
import json, sys, time
sys.stdin.readline()
sys.stdin.readline()
for _ in range(3):
    print(json.dumps({"looked_ns": time.monotonic_ns() - 2_000_000_000, "came_ns": 0, "n_bytes": 0}), flush=True)
    time.sleep(0.2)
sys.stdin.readline()
"""


def test_a_page_is_told_how_long_ago_it_was_looked_for_a_newer_picture() -> None:
    async def ask(get: _Get, door: PictureDoor) -> None:
        assert door.ages_ms() == {}
        answer = await get("?token=secret&after=0")
        assert answer.code == 204
        assert SAYS not in answer.headers
        assert not door.is_blind
        assert 2000 <= float(answer.headers[LATE]) < 2000 + 5000
        assert float(answer.headers[CAME]) == pytest.approx(time.monotonic_ns() / NS_PER_MS, abs=5000)

    _served(_LOOKS_IN_VAIN, ask)


class _Netem:
    """Answers the question for its state: junk, then that there is no run yet, then the state of a run."""

    def __init__(self, sight: SightPart | None) -> None:
        self.asked: list[str] = []
        states = [EmulatorState(running=False), EmulatorState(running=True, sight=sight)]
        self._answers = ["{}", *(state.model_dump_json() for state in states)]

    def get(self, key: str, **_: Any) -> list[SimpleNamespace]:
        self.asked.append(key)
        payload = ZBytes(self._answers[len(self.asked) - 1].encode())
        return [SimpleNamespace(ok=None), SimpleNamespace(ok=SimpleNamespace(payload=payload))]


@pytest.mark.parametrize("sight", [None, SightPart(codec="h264", fps=15)])
def test_the_video_of_a_run_is_read_from_netems_state_which_observers_may_ask_for(
    sight: SightPart | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("time.sleep", lambda _: None)
    netem = _Netem(sight)
    assert sight_asked(netem, "tis", SimpleNamespace(is_over=False)) == sight  # type: ignore[arg-type]
    password = {"kind": "password", "file": "users.txt", "observers": ["eve"]}
    rights = access_control(Password.model_validate(password), "tis", "west")
    (ask,) = [rule for rule in rights["rules"] if rule["id"] == "observers says query"]
    assert set(netem.asked) <= set(ask["key_exprs"])
