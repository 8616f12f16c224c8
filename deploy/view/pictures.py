"""The surgeon's picture for pages: a page asks for one newer than the one it has, and gets the newest.

A page has one question at a time, so that nothing waits for a slow one. The process that decodes (`picture_process`)
begins with the first question, and is asked for a picture only while a page waits.
"""

import json
import subprocess
import sys
import threading
import time
from asyncio import Future, wait
from collections.abc import Callable, Sequence
from typing import Any, Final

from bokeh.server.views.auth_request_handler import AuthRequestHandler
from tornado.ioloop import IOLoop
from tornado.web import HTTPError

from tis.common.runtime.process import child_environment, end_by_input
from tis.common.units import NS_PER_MS

PATH: Final = "/picture"
SAYS: Final = "Tis-Picture"
"""Header with what is told of a picture, as JSON."""
LATE: Final = "Tis-Late"
"""Header with the time, in ms, since it was last known that no newer picture was there: how late the page is."""
CAME: Final = "Tis-Came"
"""Header with the time, in ms, since the newest picture that is known came to the operator's side."""
MAX_WAITING: Final = 32
_MODULE: Final = ("-m", "tis.deploy.view.picture_process")
_WAIT_S: Final = 0.5
_GRACE_S: Final = 3.0
_NO_CONTENT, _BAD, _BUSY = 204, 400, 503


class PictureDoor:
    """The newest picture, and the pages that wait for it. Of one thread, the server's, but for the reader's.

    ``ahead_ns`` returns the patient's run time less this host's clock, None while it is unknown: it tells the age.
    """

    def __init__(
        self, options: dict[str, Any], ahead_ns: Callable[[], int | None], module: Sequence[str] = _MODULE
    ) -> None:
        self.newest: tuple[dict[str, Any], bytes] | None = None
        self.is_blind = False
        """Whether the run has no picture, or none that can be decoded here: then `needs` is the package for it."""
        self.needs = ""
        self._looked_ns: int | None = None
        self._came_ns: int | None = None
        self._options, self._ahead_ns, self._module = options, ahead_ns, module
        self._waiting: set[Future[None]] = set()
        self._is_asked = False
        self._process: subprocess.Popen[bytes] | None = None
        self._reader: threading.Thread | None = None

    @property
    def route(self) -> tuple[str, type[AuthRequestHandler], dict[str, Any]]:
        """Return the route, for those who may open the page."""
        return PATH, _PictureHandler, {"door": self}

    @property
    def is_full(self) -> bool:
        """Tell whether as many pages wait as can be served."""
        return len(self._waiting) >= MAX_WAITING

    def ages_ms(self) -> dict[str, float]:
        """Return by header how long ago it was looked for a newer picture, and one came; nothing before that."""
        found, now_ns = {LATE: self._looked_ns, CAME: self._came_ns}, time.monotonic_ns()
        return {name: (now_ns - at_ns) / NS_PER_MS for name, at_ns in found.items() if at_ns is not None}

    async def after(self, number: int) -> tuple[dict[str, Any], bytes] | None:
        """Return the newest picture if it has a higher number, waiting for it a while; None without."""
        if self.newest is None or self.newest[0]["number"] <= number:
            self._ask()
            mine: Future[None] = Future()
            self._waiting.add(mine)
            try:
                await wait([mine], timeout=_WAIT_S)
            finally:
                self._waiting.discard(mine)
        if self.newest is None or self.newest[0]["number"] <= number:
            return None
        said, data = self.newest
        ahead_ns = self._ahead_ns()
        age_ms = None if ahead_ns is None else (time.monotonic_ns() + ahead_ns - said["captured_ns"]) / NS_PER_MS
        return {**said, "age_ms": age_ms and round(max(age_ms, 0.0), 1)}, data

    def close(self) -> None:
        """End the process."""
        process = self._process
        if process is None:
            return
        end_by_input(process, _GRACE_S)
        if self._reader is not None:
            self._reader.join()
        assert process.stdout is not None
        process.stdout.close()

    def _ask(self) -> None:
        if self._process is None:
            self._process = self._begin()
        if self._is_asked or self.is_blind:
            return
        self._is_asked = True
        self._write(b"\n")

    def _begin(self) -> "subprocess.Popen[bytes]":
        process = subprocess.Popen(
            [sys.executable, *self._module],
            stdin=subprocess.PIPE,  # closed by the kernel when this process ends, which ends the other one
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=child_environment(),
        )
        self._process = process
        self._write(json.dumps(self._options).encode() + b"\n")
        loop = IOLoop.current()
        self._reader = threading.Thread(target=self._read, args=[process, loop], name="picture", daemon=True)
        self._reader.start()
        return process

    def _write(self, line: bytes) -> None:
        assert self._process is not None
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(line)
            self._process.stdin.flush()
        except OSError:  # it has ended
            self.is_blind = True

    def _read(self, process: "subprocess.Popen[bytes]", loop: IOLoop) -> None:
        assert process.stdout is not None
        for line in process.stdout:
            said = json.loads(line)
            data = process.stdout.read(said.pop("n_bytes"))
            loop.add_callback(self._take, said, data)
        loop.add_callback(self._take, {"number": 0}, b"")

    def _take(self, said: dict[str, Any], data: bytes) -> None:
        self._looked_ns = said.pop("looked_ns", self._looked_ns)
        self._came_ns = said.pop("came_ns", self._came_ns)
        if not said:  # it has looked, and there is no newer one
            return
        if data:
            self.newest = said, data
        else:
            self.is_blind, self.needs = True, said.get("needs", self.needs)
        self._is_asked = False
        for one in self._waiting:
            if not one.done():
                one.set_result(None)


class _PictureHandler(AuthRequestHandler):
    """Answers a page with the newest picture, or that there is none yet (204), or never will be (204, said so)."""

    def initialize(self, door: PictureDoor) -> None:
        self._door = door

    async def get(self) -> None:
        try:
            number = int(self.get_query_argument("after", "0")[:20])
        except ValueError:
            raise HTTPError(_BAD) from None
        if self._door.is_full:
            raise HTTPError(_BUSY)
        found = await self._door.after(number)
        for name, age_ms in self._door.ages_ms().items():
            self.set_header(name, f"{age_ms:.0f}")
        if found is None:
            self.set_status(_NO_CONTENT)
            if self._door.is_blind:
                self.set_header(SAYS, json.dumps({"needs": self._door.needs}))
            return
        said, data = found
        self.set_header("Content-Type", "image/jpeg")
        self.set_header(SAYS, json.dumps(said))
        await self.finish(data)
