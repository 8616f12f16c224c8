"""Page of one browser: figures, numbers and controls, refreshed from the book at the browser's pace."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final, get_args

from bokeh.core.properties import Bool, Int, List, String
from bokeh.document import Document
from bokeh.events import ConnectionLost, DocumentReady
from bokeh.model import DataModel
from bokeh.models import CustomJS, Model
from bokeh.resources import Resources
from bokeh.server.views.static_handler import StaticHandler

from tis.common.channels import Direction, Side
from tis.common.scenario.control import EmulatorState
from tis.common.sight.picture import PIXELS_PER_M
from tis.common.units import MM_PER_M, NS_PER_S
from tis.deploy.present import page as shell
from tis.deploy.present.palette import AMBER, GREEN, RED, SLATE, TONES, Tone
from tis.deploy.present.plot_style import THEME
from tis.deploy.report.network_picture import DirectionFigures, network_picture
from tis.deploy.report.plots.scene_3d import live_camera_controls
from tis.deploy.view.feed import SHOWN_S, Feed
from tis.deploy.view.lateness import JUDGED_S
from tis.deploy.view.netem_alone import NetemAlone
from tis.deploy.view.page_text import (
    PageContext,
    RunOutput,
    figures_html,
    run_html,
    run_text,
    state_html,
    vantage_text,
)
from tis.deploy.view.plots import ESTIMATE, HOLD, LOST, SCENE, STREAM_TONES, TRUTH, Plots
from tis.deploy.view.requests import RANGES
from tis.deploy.view.steering import Steering
from tis.deploy.watch.book import WINDOW_S
from tis.deploy.watch.live_figures import LiveFigures
from tis.deploy.watch.observer import Attendance, Observer
from tis.deploy.watch.streams import StreamName

# Pace of a page: the browser says which frame it has drawn, and gets no other before.

# The answer leaves after the frame's painting; a hidden page paints nothing, and answers all the same.
_ANSWER: Final = """
const answer = () => { pace.drawn = pace.sent }
if (document.hidden) setTimeout(answer)
else requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(answer)))
"""


class Pace(DataModel):
    """Number of the last frame sent, and of the last one drawn; a root without a view.

    Bokeh itself knows when a frame is written to the socket. A browser that draws slower than that queues what it
    reads, and falls ever further behind.
    """

    sent: int = Int(default=0)  # type: ignore[assignment]  # Bokeh's descriptor of an int
    drawn: int = Int(default=0)  # type: ignore[assignment]  # Bokeh's descriptor of an int

    def attach(self, doc: Document) -> None:
        """Let the browser answer once it has drawn the document, and after each frame."""
        answer = CustomJS(args={"pace": self}, code=_ANSWER)
        doc.js_on_event(DocumentReady, answer)
        self.js_on_change("sent", answer)

    @property
    def is_drawing(self) -> bool:
        """Tell whether the last frame is not drawn yet."""
        return self.drawn != self.sent

    def end_frame(self) -> None:
        """Ask for an answer; call it after the last change of a frame."""
        self.sent += 1


# The network on the live page: state of the three sides and of both directions, as a picture.

_STREAMS: Final[dict[Direction, StreamName]] = {"forward": "arm", "feedback": "answers"}


def network_html(
    attendance: Attendance, now_s: float, context: PageContext, found: LiveFigures, state: EmulatorState | None
) -> str:
    """Return the picture of the sides and of both directions, with the figures of the last seconds."""
    links = {direction: _direction(direction, found, state) for direction in get_args(Direction)}
    return network_picture(links, {side: _side(side, attendance, now_s, context) for side in get_args(Side)})


def _direction(direction: Direction, found: LiveFigures, state: EmulatorState | None) -> DirectionFigures:
    """Return the figures of the arm's samples or of the estimates on their way back, and netem's outage."""
    seen = found.streams.get(_STREAMS[direction])
    now = None if state is None else getattr(state, direction)
    outage_s = 0.0 if now is not None and now.outage else None
    if seen is None:
        return DirectionFigures(None, None, outage_s)
    return DirectionFigures(seen.delay_p50_ms, seen.loss_pct, outage_s)


def _side(side: Side, attendance: Attendance, now_s: float, context: PageContext) -> tuple[str, Tone]:
    """Return the state of a side in words, and its colour."""
    if "netem" in attendance.left:
        return "has ended", SLATE
    if side in attendance.left:
        return "has left", RED
    if side in attendance.present:
        return "running" if now_s > 0 else "ready", GREEN
    return "starting" if context.beside else "not there yet", AMBER


FRAME_MS: Final = 200
_IS_AXIS: Final = 1.0 - 1e-9
_TEXT_EVERY: Final = 2
_STATE_EVERY: Final = 5
_HERE: Final = Path(__file__).parent
_ON_CHANGE: Final = "window.live.show(words)"
_ON_LOSS: Final = """
cb_data.connection.deref()?.close()  // or each change of the window's size would be an error for want of a server
window.live.lose(words)
"""


class Words(DataModel):
    """Texts of the page as markup, by the id of their element; the browser's script shows them."""

    sides: str = String(default="")  # type: ignore[assignment]  # Bokeh's descriptors
    figures: str = String(default="")  # type: ignore[assignment]
    state: str = String(default="")  # type: ignore[assignment]
    is_alone: bool = Bool(default=False)  # type: ignore[assignment]
    """Whether netem runs by itself: what is of a run is hidden."""
    is_over: bool = Bool(default=False)  # type: ignore[assignment]
    is_reported: bool = Bool(default=False)  # type: ignore[assignment]
    arms: list[str] = List(String)  # type: ignore[assignment]
    shown: str = String(default="")  # type: ignore[assignment]
    chosen: str = String(default="")  # type: ignore[assignment]
    """The arm that the reader chose."""

    def attach(self, doc: Document) -> None:
        """Let the browser show each change, and the end of the connection."""
        show = CustomJS(args={"words": self}, code=_ON_CHANGE)
        doc.js_on_event(DocumentReady, show)
        for name in ("sides", "figures", "state", "is_alone", "is_over", "is_reported", "arms"):
            self.js_on_change(name, show)
        doc.js_on_event(ConnectionLost, CustomJS(args={"words": self}, code=_ON_LOSS))


class Page:
    """Document of one browser, which gets its next frame when it has drawn the last one.

    ``output`` returns the run's output once it is known.
    """

    def __init__(
        self, doc: Document, observer: Observer, steering: Steering, context: PageContext,
        output: Callable[[], RunOutput | None], alone: NetemAlone | None = None,
    ) -> None:  # fmt: skip
        self._doc = doc
        self._alone = alone or NetemAlone()
        self._observer = observer
        self._steering = steering
        self._context = context
        self._output = output
        self._feed = Feed()
        self._n_frames = 0
        self.pace: Final = Pace()
        self.words: Final = Words()
        self._known: EmulatorState | None = None
        self._modes: dict[str, str] = {}
        self._plots = Plots()
        self.words.on_change("chosen", lambda _attr, _old, new: self._select_arm(new))
        roots: dict[str, Model] = {**self._plots.roots(), "words": self.words, "pace": self.pace}
        for name, model in roots.items():
            model.name = name
            doc.add_root(model)
        self.words.attach(doc)
        self.pace.attach(doc)

    def refresh(self) -> None:
        """Draw the new rows; text changes less often than lines, and after the run only text changes.

        A change of what an arm does is told at once, also to a slow browser: the driven picture tells it, too.
        """
        attendance = self._observer.attendance()
        over = "netem" in attendance.left or self._alone.is_over
        modes = self._observer.read(lambda book: book.safety.modes())
        is_news, self._modes = modes != self._modes, modes
        if self.pace.is_drawing and not over:
            if is_news:
                self._refresh_text(attendance)
            return
        words = self.words
        if not (over and words.is_over):
            frame = self._observer.read(self._feed.advance)
            self._plots.show(frame)
            if list(frame.arms) != words.arms:
                words.update(shown=frame.arm or "", arms=list(frame.arms))
        if over or is_news or self._n_frames % _TEXT_EVERY == 0:
            self._refresh_text(attendance)
        if over:
            self._known = None
            words.state = "<p>The network has ended.</p>"
            output = self._output()
            words.update(is_over=True, is_reported=output is not None and output.what == "report")
        elif self._alone.is_there:
            words.update(is_alone=True, state=self._alone.state_html())
        elif "netem" in attendance.present and self._n_frames % _STATE_EVERY == 0:
            self._known = self._steering.state()
            words.state = state_html(self._known)
        self._n_frames += 1
        if not over:
            self.pace.end_frame()

    def _refresh_text(self, attendance: Attendance) -> None:
        if self._alone.is_there:
            said = self._alone.words()
            self.words.update(sides=f'<p class="run">{said}</p>', figures=self._alone.figures_html())
            self._title(said)
            return
        now_s, figures, n_missed, safety, alarms = self._observer.read(
            lambda book: (
                book.now_ns / NS_PER_S, book.figures(), dict(book.ticks_missed), book.safety.stretches(SHOWN_S),
                book.alarms,
            )
        )  # fmt: skip
        self.words.sides = run_html(attendance, now_s, self._context, self._output(), alarms)
        picture = network_html(attendance, now_s, self._context, figures, self._known)
        note = vantage_text(self._observer.vantage(), self._context)
        self.words.figures = figures_html(figures, n_missed, picture, note, safety, self._is_hold())
        self._title(run_text(attendance, now_s, self._context))

    def _is_hold(self) -> bool:
        return self._context.about is not None and self._context.about.active_estimator == "hold"

    def _title(self, said: str) -> None:
        title = f"tis live: {said}"
        if self._doc.title != title:
            self._doc.title = title

    def _select_arm(self, arm: str) -> None:
        if arm in self.words.arms:  # a browser may send anything
            self._feed.arm = arm


_SWINGS_MS: Final = (0, 300)
"""Delays there and back, in ms, at which the loop of `drive_touch` is stable and swings."""

_STYLES: Final = ("page.css", "words.css", "controls.css", "drive.css")
_SCRIPTS: Final = (
    "page.js",
    "picture_layout.js",
    "touch_task.js",
    "drive.js",
    "sight.js",
    "controls.js",
    "touches.js",
)


def _tones() -> dict[str, str]:
    """Return the colours of the template by name, for light and dark pages."""
    tones: dict[str, Tone] = {
        "truth": TRUTH,
        "estimate": ESTIMATE,
        "hold": HOLD,
        "lost": LOST,
        "ghost": GREEN,
        "really": AMBER,
    }
    tones |= {str(name): tone for name, tone in STREAM_TONES.items()}
    return {name: shell.css(tone) for name, tone in tones.items()}


def _axis_words(vector: Sequence[float]) -> str:
    """Return a direction in words: an axis by its name."""
    for axis, value in zip("xyz", vector, strict=True):
        if abs(value) > _IS_AXIS:
            return axis if value > 0.0 else f"-{axis}"
    return f"({', '.join(f'{value:.2g}' for value in vector)})"


def pages(
    observer: Observer,
    steering: Steering,
    profiles: Mapping[str, str],
    context: PageContext,
    output: Callable[[], RunOutput | None],
    alone: NetemAlone,
) -> Callable[[Document], None]:
    """Return the function that fills a new document for each browser."""
    template, about = (_HERE / "page.html").read_text(encoding="utf-8"), context.about
    styles = [shell.HERE / "tones.css", *(_HERE / name for name in _STYLES)]
    scripts = [*(_HERE / name for name in _SCRIPTS), shell.HERE / "page.js", shell.HERE / "camera.js"]
    resources = Resources(
        mode="server", root_url="/", path_versioner=StaticHandler.append_version, components=["bokeh"]
    )
    variables = {
        "css": "".join(path.read_text(encoding="utf-8") for path in styles),
        "script": "".join(path.read_text(encoding="utf-8") for path in scripts),
        "tones": _tones(),
        "driven": context.is_driven,
        "about": about,
        "is_reported": context.is_reported,
        "may_see": about is None or about.has_picture,
        "px_per_mm": f"{PIXELS_PER_M / MM_PER_M:g}",
        "picture": None if about is None else about.picture,
        "direction": _axis_words,
        "profiles": profiles,
        "ranges": RANGES,
        "judged_s": f"{JUDGED_S:g}",
        "bokeh_urls": resources.js_files,
        "drive_tones": json.dumps(
            {
                name: [tone.light, tone.dark]
                for name, tone in (
                    ("hand", STREAM_TONES["master"]),
                    ("shown", TRUTH),
                    ("ghost", GREEN),
                    ("estimate", ESTIMATE),
                    ("arm", AMBER),
                )
            }
        ),
        "pairs": json.dumps([[tone.light, tone.dark] for tone in TONES]),
        "window_s": WINDOW_S,
        "swings_ms": _SWINGS_MS,
        "camera": live_camera_controls(SCENE, SHOWN_S),
    }

    def make(doc: Document) -> None:
        doc.theme = THEME
        doc.title = "tis live"
        doc.template = template  # type: ignore[assignment]  # Bokeh accepts text and extends its base template
        doc.template_variables.update(variables)
        doc.config.update(reconnect_session=False, notify_connection_status=False)  # the page has its own notice
        with doc.models.freeze():  # or each root added and each change walks all models
            page = Page(doc, observer, steering, context, output, alone)
            page.refresh()
        doc.add_periodic_callback(page.refresh, FRAME_MS)

    return make
