"""WebSocket of a page that shows the surgeon's display and may drive: pictures go out, moves of the hand come in."""

import json
import time
from collections import deque
from typing import TYPE_CHECKING, Any, Final

from bokeh.server.views.auth_request_handler import AuthRequestHandler
from tornado.ioloop import IOLoop
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from tis.deploy.view.drive import MAX_DROPPED, MAX_RATE_HZ, DriveHub, Rate, read_message
from tis.deploy.view.requests import Ask, PageRequest

if TYPE_CHECKING:
    from concurrent.futures import Future

PATH: Final = "/drive"
FRAME_MS: Final = 33
MAX_PAGES: Final = 32
_MAX_PATH: Final = 2000
TOO_MANY: Final = f"more than {MAX_RATE_HZ} moves a second"
_POLICY_VIOLATION: Final = 1008  # RFC 6455, section 7.4.1
_TRY_AGAIN: Final = 1013


class DriveSockets:
    """The connections of all pages, which get a picture at each `send`; a page that is slow misses some."""

    def __init__(self, hub: DriveHub) -> None:
        self.hub: Final = hub
        self.pages: Final[set[DriveSocket]] = set()

    @property
    def route(self) -> tuple[str, type[AuthRequestHandler], dict[str, Any]]:
        """Return the route, for those who may open the page."""
        return PATH, DriveSocket, {"sockets": self}

    def send(self) -> None:
        """Send the picture to every page that has taken the last one."""
        if not self.pages:
            return
        frame = self.hub.frame(time.monotonic())
        for page in tuple(self.pages):
            driver = self.hub.seat.driver
            page.send({**frame, "driver": "you" if driver is page else "other" if driver is not None else "nobody"})


class DriveSocket(AuthRequestHandler, WebSocketHandler):
    """One page. Tornado's check admits the page's own origin only; the token is checked first."""

    def initialize(self, sockets: DriveSockets) -> None:
        """Set up the connection; Tornado calls it."""
        self._sockets = sockets
        self._rate = Rate(at_s=time.monotonic())
        self._sending: Future[None] | None = None
        self._refused = ""
        self._asked: set[Ask] = set()
        self._path: deque[list[float]] = deque(maxlen=_MAX_PATH)

    def open(self, *_: str, **__: str) -> None:
        """Admit the page, unless there are too many."""
        if len(self._sockets.pages) >= MAX_PAGES:
            self.close(_TRY_AGAIN, f"{MAX_PAGES} pages are open")
            return
        self._sockets.pages.add(self)

    def on_message(self, message: str | bytes) -> None:
        """Move the hand, or answer in words why not; what comes too fast is dropped."""
        now_s = time.monotonic()
        if not self._rate.takes(now_s):
            if self._rate.n_dropped > MAX_DROPPED:
                self.close(_POLICY_VIOLATION, TOO_MANY)
            elif self._rate.n_dropped == 1:
                self._answer(TOO_MANY)
            return
        found = read_message(message)
        if isinstance(found, PageRequest):
            self._ask(found)
            return
        refused = found if isinstance(found, str) else self._sockets.hub.drive(self, found, now_s)
        if refused or self._refused:
            self._answer(refused, lost=bool(refused))

    def on_close(self) -> None:
        """Free the seat: the hand holds."""
        self._sockets.pages.discard(self)
        self._sockets.hub.leave(self)

    def send(self, content: dict[str, Any]) -> None:
        """Send a picture, unless the last one is still on its way; the next one has the arm's path of both."""
        self._path.extend(content["arm_path"])
        if self._sending is None or self._sending.done():
            path = list(self._path)
            self._path.clear()
            try:
                self._sending = self.write_message(json.dumps({**content, "arm_path": path}))  # type: ignore[assignment]
            except WebSocketClosedError:
                self.on_close()

    def _ask(self, request: PageRequest) -> None:
        """Do what the page asks, of each kind one at a time, and tell it the answer."""
        kind, loop = request.ask, IOLoop.current()
        if kind in self._asked:
            self._tell({"asked": kind, "answer": "not done: the one before is still under way"})
            return
        self._asked.add(kind)

        def tell(text: str) -> None:
            self._asked.discard(kind)
            self._tell({"asked": kind, "answer": text})

        self._sockets.hub.ask(request, lambda text: loop.add_callback(tell, text))

    def _answer(self, refused: str, lost: bool = False) -> None:
        """Tell the page that its moves are refused, once for each reason, or that they are taken again.

        ``lost``: it does not drive, however it goes on. Moves that came too fast are left out, and it drives on.
        """
        if refused == self._refused:
            return
        self._refused = refused
        self._tell({"refused": refused} | ({"lost": True} if lost else {}))

    def _tell(self, content: dict[str, Any]) -> None:
        try:
            self.write_message(json.dumps(content))
        except WebSocketClosedError:
            self.on_close()
