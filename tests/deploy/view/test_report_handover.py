"""The report goes to those who may open the page, once there is one."""

import asyncio
from pathlib import Path

from bokeh.application import Application
from tornado.httpclient import AsyncHTTPClient, HTTPResponse
from tornado.ioloop import IOLoop

from tis.deploy.view.access import Access
from tis.deploy.view.page_text import RunOutput
from tis.deploy.view.server import ReportHandover, listen, n_open

_TOKEN = "secret"


def test_it_is_sent_once_it_is_there_and_only_with_the_token(tmp_path: Path) -> None:
    report = tmp_path / "report.html"
    report.write_text("<h1>µ</h1>", encoding="utf-8")
    outputs: list[RunOutput] = []

    async def main() -> None:
        handover = ReportHandover(lambda: outputs[-1] if outputs else None)
        access = Access("127.0.0.1", ("127.0.0.1",), _TOKEN)
        server, port = listen(Application(), access, 0, IOLoop.current(), [handover.route])
        server.start()

        async def get(query: str) -> HTTPResponse:
            return await AsyncHTTPClient().fetch(f"http://127.0.0.1:{port}/report{query}", raise_error=False)

        assert (await get(f"?token={_TOKEN}")).code == 404
        outputs.append(RunOutput("folder", str(tmp_path)))
        assert (await get(f"?token={_TOKEN}")).code == 404
        outputs.append(RunOutput("report", str(report)))
        assert [(await get(query)).code for query in ("", "?token=guess")] == [403, 403]
        assert handover.n_sent == 0
        answer = await get(f"?token={_TOKEN}")
        assert answer.body.decode() == "<h1>µ</h1>"
        assert answer.headers["Content-Type"] == "text/html; charset=utf-8"
        assert (handover.n_sent, n_open(server)) == (1, 0)
        server.stop(wait=False)
        server.unlisten()

    asyncio.run(main())
