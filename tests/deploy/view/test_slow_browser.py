"""A browser that stops reading holds up nothing but itself, and nothing is queued for it."""

import asyncio
import re
from collections import Counter

import numpy as np
import pytest
from bokeh.application import Application
from bokeh.application.handlers import FunctionHandler
from bokeh.document import Document
from bokeh.models import ColumnDataSource
from tornado.httpclient import AsyncHTTPClient, HTTPRequest
from tornado.ioloop import IOLoop
from tornado.websocket import WebSocketClientConnection, websocket_connect

from tis.deploy.view.access import access_to
from tis.deploy.view.server import listen

pytestmark = pytest.mark.live

_ACCESS = access_to("127.0.0.1")
_N = 50_000  # of 8 bytes each: some frames fill every buffer on the way


async def _browser(place: str) -> WebSocketClientConnection:
    client = AsyncHTTPClient(force_instance=True)
    answer = await client.fetch(f"http://{place}/?token={_ACCESS.token}")
    client.close()
    found = re.search(r'"token":"([^"]+)"', answer.body.decode())
    assert found is not None
    cookie = answer.headers["Set-Cookie"].partition(";")[0]
    request = HTTPRequest(f"ws://{place}/ws", headers={"Origin": f"http://{place}", "Cookie": cookie})
    browser = await websocket_connect(request, subprotocols=["bokeh", found[1]], max_message_size=1 << 27)
    assert "ACK" in str(await browser.read_message())
    return browser


def test_it_loses_frames_and_the_others_do_not() -> None:
    made: Counter[int] = Counter()
    docs: list[Document] = []

    def page(doc: Document) -> None:
        source = ColumnDataSource({"t": np.zeros(_N)})
        doc.add_root(source)
        docs.append(doc)

        def refresh() -> None:
            made[id(doc)] += 1
            source.data = {"t": np.random.default_rng(made[id(doc)]).random(_N)}

        doc.add_periodic_callback(refresh, 10)

    async def main() -> None:
        server, port = listen(Application(FunctionHandler(page)), _ACCESS, 0, IOLoop.current())
        server.start()
        asleep = await _browser(f"127.0.0.1:{port}")  # its client takes no message until it is asked for one
        awake = await _browser(f"127.0.0.1:{port}")
        slow, quick = (id(doc) for doc in docs)
        n_read = 0

        async def read(until: int) -> None:
            nonlocal n_read
            while made[quick] < until:
                assert await awake.read_message() is not None
                n_read += 1

        await asyncio.wait_for(read(60), 30)
        stalled = made[slow]
        await asyncio.wait_for(read(120), 30)
        assert made[slow] == stalled < 60  # the one frame that is under way, and no more
        assert n_read >= 100
        for browser in (asleep, awake):
            browser.close()
            while await browser.read_message() is not None:
                pass
        server.stop(wait=False)
        server.unlisten()
        await asyncio.sleep(0)

    asyncio.run(main())
