"""Handover of the run's report to the pages that are open at its end: their link works when the server is gone."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from bokeh.server.views.auth_request_handler import AuthRequestHandler
from tornado.web import HTTPError

from deploy.view.page_text import RunOutput

PATH: Final = "/report"
_NOT_FOUND: Final = 404


class ReportHandover:
    """Report of the run, once it exists, and the number of pages that have it."""

    def __init__(self, output: Callable[[], RunOutput | None]) -> None:
        self.n_sent = 0
        self._output = output

    @property
    def report(self) -> Path | None:
        """Return the file of the report; None before the end and for a run without a report."""
        output = self._output()
        return Path(output.path) if output is not None and output.what == "report" else None

    @property
    def route(self) -> tuple[str, type[AuthRequestHandler], dict[str, Any]]:
        """Return the route of the report, for those who may open the page."""
        return PATH, _ReportHandler, {"handover": self}


class _ReportHandler(AuthRequestHandler):
    """Sends the report, and counts it when it is sent."""

    def initialize(self, handover: ReportHandover) -> None:
        self._handover = handover

    async def get(self) -> None:
        report = self._handover.report
        if report is None:
            raise HTTPError(_NOT_FOUND)
        self.set_header("Content-Type", "text/html; charset=utf-8")
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Cache-Control", "no-store")
        await self.finish(report.read_bytes())
        self._handover.n_sent += 1
