"""Server of the page: observer, control connection to netem, and Bokeh's server on one port."""

import errno
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import Any, Final

from bokeh.application import Application
from bokeh.application.handlers import FunctionHandler
from bokeh.server.server import BaseServer
from bokeh.server.tornado import BokehTornado
from bokeh.server.views.auth_request_handler import AuthRequestHandler
from bokeh.util.token import generate_secret_key
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop, PeriodicCallback
from tornado.netutil import bind_sockets
from tornado.web import HTTPError

from tis.common.channels import Network
from tis.common.errors import Fault, InputError, PeerError
from tis.common.runtime.emulator_client import EmulatorAddress
from tis.common.runtime.zenoh_session import ZenohOptions
from tis.deploy.view.access import Access, TokenAuth, access_to
from tis.deploy.view.device import Device, DeviceDoor
from tis.deploy.view.drive import DriveHub
from tis.deploy.view.drive_socket import FRAME_MS, DriveSockets
from tis.deploy.view.hold_reason import RunAbout
from tis.deploy.view.netem_alone import NetemAlone
from tis.deploy.view.page import pages
from tis.deploy.view.page_text import PageContext, RunOutput
from tis.deploy.view.pictures import PictureDoor
from tis.deploy.view.steering import Steering, live_profiles
from tis.deploy.watch.observer import Observer

# Handover of the run's report to the pages that are open at its end: their link works when the server is gone.

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
        await self.finish(report.read_bytes())
        self._handover.n_sent += 1


_POLL_S: Final = 0.2
_ASK_EVERY_S: Final = 1.0
_FINAL_UPDATE_S: Final = 0.6
_HANDOVER_S: Final = 3.0
_UNUSED_MS: Final = 10_000
_MAX_MESSAGE_BYTES: Final = 1 << 20


@dataclass(frozen=True)
class ViewOptions:
    """Endpoints of the run and address of the page; ``beside``: the same command also starts the run."""

    west: str
    east: str
    session: str = "tis"
    address: str = "127.0.0.1"
    port: int = 0
    hosts: tuple[str, ...] = ()
    wait_s: float | None = None
    beside: bool = False
    config: str | None = None
    cfg: tuple[str, ...] = ()
    credentials: Mapping[str, Any] = field(default_factory=dict, repr=False)
    secret: str | None = None
    """File of the run's shared secret, by which stops and releases are signed."""

    device: Mapping[str, Any] | None = None
    """The device that a page can be, where the run's source is live: the fields of a `Device`."""

    sight: Mapping[str, Any] | None = None
    """The fields of the run's `SightPart`, where the command that serves the page also starts the run."""

    about: Mapping[str, Any] | None = None
    """The fields of a `RunAbout`, where the command that serves the page also starts the run."""

    reports: bool = True
    """Whether that command writes a report at the end."""

    @property
    def zenoh(self) -> ZenohOptions:
        """Return the Zenoh options of the connections."""
        file = None if self.config is None else Path(self.config)
        return ZenohOptions(config=file, cfg=self.cfg, credentials=self.credentials)


def serve(
    options: ViewOptions, on_ready: Callable[[str], None], stopped: Callable[[], bool],
    output: Callable[[], RunOutput | None] = lambda: None,
) -> None:  # fmt: skip
    """Serve the page until the end of the run or, with ``beside``, until ``stopped``.

    ``on_ready`` gets the page's address, ``output`` returns the run's output once it exists. Raises `InputError` when
    it cannot listen there, `PeerError` when no netem answers within ``wait_s``. A slow browser gets fewer frames; no
    browser slows the run.
    """
    # Everything that may refuse comes first: address, then port; nothing is observed before the server listens.
    access = _access(options)
    for name in ("bokeh", "tornado.access", "tornado.application"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    endpoints: dict[Network, str] = {"west": options.west, "east": options.east}
    observer = Observer(endpoints, options.session, zenoh=options.zenoh)
    secret = None if options.secret is None else Path(options.secret)
    steering = Steering(EmulatorAddress(options.east, options.session, options.zenoh, secret))
    about = None if options.about is None else RunAbout(**options.about)
    is_driven = options.device is not None
    context = PageContext(options.beside, options.west, options.east, is_driven, about, options.reports)
    door = None if options.device is None else DeviceDoor(Device(**options.device), options.west, options.zenoh)
    alone = NetemAlone()
    sockets = DriveSockets(DriveHub(observer, steering, door, about, alone))
    pictures = PictureDoor(_of_pictures(options), lambda: observer.read(lambda book: book.patient_ahead_ns))
    pictures.is_blind = about is not None and not about.has_picture
    application = Application(FunctionHandler(pages(observer, steering, live_profiles(), context, output, alone)))
    loop = IOLoop()
    loop.make_current()
    handover = ReportHandover(output)
    server, port = listen(application, access, options.port, loop, [handover.route, sockets.route, pictures.route])
    watch = _Watch(loop, observer, stopped, options, alone, steering)
    watch.awaits = lambda: handover.report is not None and handover.n_sent < n_open(server)
    poll = PeriodicCallback(watch.poll, timedelta(seconds=_POLL_S))
    sending = PeriodicCallback(sockets.send, FRAME_MS)
    try:
        observer.start()
        if door is not None:
            door.start()
        sending.start()
        server.start()
        poll.start()
        loop.add_callback(partial(on_ready, access.url(port)))
        loop.start()
    finally:
        poll.stop()
        sending.stop()
        server.stop(wait=False)
        server.unlisten()
        steering.close()
        if door is not None:
            door.close()
        pictures.close()
        observer.stop()
        loop.close(all_fds=True)
    if observer.error is not None:
        raise observer.error
    if watch.gave_up:
        raise PeerError(Fault("tis view", options.west, watch.gave_up))


class _Watch:
    """Periodic check that ends the server: at the end of the run, on request, or at the timeout."""

    def __init__(
        self, loop: IOLoop, observer: Observer, stopped: Callable[[], bool], options: ViewOptions,
        alone: NetemAlone, steering: Steering,
    ) -> None:  # fmt: skip
        self.is_over = False
        self.gave_up = ""
        """Why no netem was found, in words; "" while one is there or awaited."""
        self._loop, self._observer, self._stopped, self._options = loop, observer, stopped, options
        self.awaits: Callable[[], bool] = lambda: False
        self._alone, self._steering = alone, steering
        self._begun_s = self._asked_s = loop.time()
        self._ending = False

    def poll(self) -> None:
        if self._ending:
            return
        attendance = self._observer.attendance()
        if attendance.connected and "netem" not in attendance.present and not self._options.beside:
            self._look_for_netem_alone()
        self.is_over = "netem" in attendance.left or self._alone.is_over
        if not self._alone.is_there and "netem" not in attendance.present | attendance.left:
            self.gave_up = self._steering.other_prefix or self._timed_out()
        over = self.is_over and not self._options.beside
        if over or self.gave_up or self._stopped() or self._observer.error is not None:
            self._ending = True
            # pages show the end, and take the report, before the connection closes
            self._loop.call_later(_FINAL_UPDATE_S if self.is_over else 0, self._stop, self._loop.time() + _HANDOVER_S)

    def _timed_out(self) -> str:
        limit_s = self._options.wait_s
        is_late = limit_s is not None and self._loop.time() - self._begun_s > limit_s
        return f"no answer from a run with prefix {self._options.session} within {limit_s} s" if is_late else ""

    def _look_for_netem_alone(self) -> None:
        """Ask for its state once a second: a netem that runs by itself has no other sign of life."""
        now_s = self._loop.time()
        if now_s - self._asked_s >= _ASK_EVERY_S:
            self._asked_s = now_s
            self._alone.take(self._steering.state(), now_s)

    def _stop(self, until_s: float) -> None:
        if self.awaits() and self._loop.time() < until_s:
            self._loop.call_later(_POLL_S, self._stop, until_s)
        else:
            self._loop.stop()


def _of_pictures(options: ViewOptions) -> dict[str, Any]:
    zenoh = {"config": options.config, "cfg": options.cfg, "credentials": dict(options.credentials)}
    return {"west": options.west, "session": options.session, "sight": options.sight, "zenoh": zenoh}


def _access(options: ViewOptions) -> Access:
    try:
        return access_to(options.address, options.hosts)
    except ValueError as error:
        raise InputError(
            Fault("tis view", "--address", f"must be an address of this host: {error}", options.address)
        ) from None


def listen(
    application: Application, access: Access, port: int, loop: IOLoop, routes: Sequence[Any] = ()
) -> tuple[BaseServer, int]:
    """Return a server that listens on ``port`` (0: any free port), and its port; raises `InputError`.

    Only a page creates sessions, and only a session from the page's own origin may connect. ``routes`` are Tornado's,
    beside those of the page.
    """
    try:
        sockets = bind_sockets(port, access.address)
    except OSError as error:
        if error.errno == errno.EADDRNOTAVAIL:
            fault = Fault("tis view", "--address", f"cannot be listened on: {error.strerror}", access.address)
        else:
            fault = Fault("tis view", "--port", f"cannot listen there: {error.strerror}", port)
        raise InputError(fault) from None
    bound_port = int(sockets[0].getsockname()[1])
    tornado = BokehTornado(
        {"/": application}, extra_websocket_origins=access.origins(bound_port), sign_sessions=True,
        secret_key=generate_secret_key().encode(), generate_session_ids=True,
        unused_session_lifetime_milliseconds=_UNUSED_MS, check_unused_sessions_milliseconds=_UNUSED_MS // 2,
        extra_patterns=list(routes),
        websocket_max_message_size_bytes=_MAX_MESSAGE_BYTES, auth_provider=TokenAuth(access.token),
    )  # fmt: skip
    http = HTTPServer(access.guard(tornado))
    http.add_sockets(sockets)
    return BaseServer(loop, tornado, http), bound_port


def n_open(server: BaseServer) -> int:
    """Return the number of pages that are open."""
    return sum(session.connection_count > 0 for session in server.get_sessions("/"))
