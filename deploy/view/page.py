"""Page of one browser: figures, numbers and controls, refreshed from the book at the browser's pace."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Final, get_args

from bokeh.core.properties import Int
from bokeh.document import Document
from bokeh.events import ConnectionLost, DocumentReady
from bokeh.model import DataModel
from bokeh.models import CustomJS, InlineStyleSheet, Model
from bokeh.models.widgets.inputs import Select
from bokeh.models.widgets.markups import Div

from tis.common.channels import Direction, Side
from tis.common.scenario.control import EmulatorState
from tis.common.units import NS_PER_S
from tis.deploy.present import page as shell
from tis.deploy.present.palette import AMBER, GREEN, RED, SLATE, TONES, Tone
from tis.deploy.present.plot_style import THEME
from tis.deploy.report.network_picture import DirectionFigures, network_picture
from tis.deploy.report.plots.scene_3d import live_camera_controls
from tis.deploy.view.controls import Controls
from tis.deploy.view.feed import SHOWN_S, Feed
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
_TEXT_EVERY: Final = 2
_STATE_EVERY: Final = 5
_HERE: Final = Path(__file__).parent
_OVER: Final = "over"
_REPORTED: Final = "reported"
_LOST: Final = (
    "<p>The connection to the page's server is lost, so nothing below changes any more. "
    '<a href="">Load the page again</a> when it can be reached.</p>'
)
_ON_END: Final = """
if (!sides.tags.includes(report)) return
const link = document.getElementById("report")
fetch("report").then((answer) => answer.ok ? answer.blob() : null).then((page) => {
  if (page === null) return
  link.querySelector("a").href = URL.createObjectURL(page)  // kept by the browser: the server ends with the run
  link.hidden = false
}, () => {})  // the server is gone; the path of the report is on the page
"""
_ON_LOSS: Final = """
cb_data.connection.deref()?.close()  // or each change of the window's size would be an error for want of a server
for (const widget of widgets) widget.disabled = true
lost.visible = !sides.tags.includes(over)
"""


class Page:
    """Document of one browser, which gets its next frame when it has drawn the last one.

    ``output`` returns the run's output once it is known.
    """

    def __init__(
        self, doc: Document, observer: Observer, steering: Steering, profiles: list[str], context: PageContext,
        output: Callable[[], RunOutput | None],
    ) -> None:  # fmt: skip
        self._doc = doc
        self._observer = observer
        self._steering = steering
        self._context = context
        self._output = output
        self._feed = Feed()
        self._n_frames = 0
        self.pace: Final = Pace()
        self._known: EmulatorState | None = None
        style = InlineStyleSheet(css=(_HERE / "words.css").read_text(encoding="utf-8"))
        self._plots = Plots()
        self._sides, self._figures, self._state, lost = (
            Div(stylesheets=[style], sizing_mode="stretch_width") for _ in range(4)
        )
        lost.update(text=_LOST, visible=False, css_classes=["lost"], html_attributes={"role": "alert"})
        self._controls = Controls(doc, steering, profiles, style)
        self._arm = Select(title="Arm", options=[], visible=False, width=120, stylesheets=[self._controls.style])
        self._arm.on_change("value", lambda _attr, _old, new: self._select_arm(new))
        roots: dict[str, Model] = {
            **self._plots.roots(), "lost": lost, "sides": self._sides, "figures": self._figures,
            "state": self._state, "arm": self._arm, "controls": self._controls.layout,
            "answer": self._controls.answer, "pace": self.pace,
        }  # fmt: skip
        for name, model in roots.items():
            model.name = name
            doc.add_root(model)
        args = {"lost": lost, "sides": self._sides, "widgets": self._controls.widgets, "over": _OVER}
        doc.js_on_event(ConnectionLost, CustomJS(args=args, code=_ON_LOSS))
        self._sides.js_on_change("tags", CustomJS(args={"sides": self._sides, "report": _REPORTED}, code=_ON_END))
        self.pace.attach(doc)

    def refresh(self) -> None:
        """Draw the new rows; text changes less often than lines, and after the run only text changes."""
        attendance = self._observer.attendance()
        over = "netem" in attendance.left
        if self.pace.is_drawing and not over:
            return
        if not (over and _OVER in self._sides.tags):
            frame = self._observer.read(self._feed.advance)
            self._plots.show(frame)
            if list(frame.arms) != self._arm.options:
                self._arm.update(options=list(frame.arms), value=frame.arm, visible=len(frame.arms) > 1)
            self._controls.enable("netem" in attendance.present and frame.now_s > 0)
        if over or self._n_frames % _TEXT_EVERY == 0:
            self._refresh_text(attendance)
        if over:
            self._known = None
            self._state.text = "<p>The network has ended with the run.</p>"
            output = self._output()
            self._sides.tags = [_OVER, _REPORTED] if output is not None and output.what == "report" else [_OVER]
        elif "netem" in attendance.present and self._n_frames % _STATE_EVERY == 0:
            self._known = self._steering.state()
            self._state.text = state_html(self._known)
        self._n_frames += 1
        if not over:
            self.pace.end_frame()

    def _refresh_text(self, attendance: Attendance) -> None:
        now_s, figures, n_missed, safety, alarms = self._observer.read(
            lambda book: (
                book.now_ns / NS_PER_S, book.figures(), book.n_ticks_missed, book.safety.stretches(SHOWN_S),
                book.alarms,
            )
        )  # fmt: skip
        self._sides.text = run_html(attendance, now_s, self._context, self._output(), alarms)
        picture = network_html(attendance, now_s, self._context, figures, self._known)
        note = vantage_text(self._observer.vantage(), self._context)
        self._figures.text = figures_html(figures, n_missed, picture, note, safety)
        title = f"tis live: {run_text(attendance, now_s, self._context)}"
        if self._doc.title != title:
            self._doc.title = title

    def _select_arm(self, arm: str) -> None:
        self._feed.arm = arm


def pages(
    observer: Observer,
    steering: Steering,
    profiles: list[str],
    context: PageContext,
    output: Callable[[], RunOutput | None],
) -> Callable[[Document], None]:
    """Return the function that fills a new document for each browser."""
    template = (_HERE / "page.html").read_text(encoding="utf-8")
    styles = (shell.HERE / "tones.css", _HERE / "page.css", _HERE / "drive.css")
    scripts = (_HERE / "page.js", shell.HERE / "page.js", shell.HERE / "camera.js", _HERE / "drive.js")
    tones: dict[str, Tone] = {
        "truth": TRUTH,
        "estimate": ESTIMATE,
        "hold": HOLD,
        "lost": LOST,
        "ghost": GREEN,
        "really": AMBER,
    }
    tones |= {str(name): tone for name, tone in STREAM_TONES.items()}
    variables = {
        "css": "".join(path.read_text(encoding="utf-8") for path in styles),
        "script": "".join(path.read_text(encoding="utf-8") for path in scripts),
        "tones": {name: f"light-dark({tone.light},{tone.dark})" for name, tone in tones.items()},
        "driven": context.is_driven,
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
        "camera": live_camera_controls(SCENE, SHOWN_S),
    }

    def make(doc: Document) -> None:
        doc.theme = THEME
        doc.title = "tis live"
        doc.template = template  # type: ignore[assignment]  # Bokeh accepts text and extends its base template
        doc.template_variables.update(variables)
        doc.config.update(reconnect_session=False, notify_connection_status=False)  # the page has its own notice
        with doc.models.freeze():  # or each root added and each change walks all models
            page = Page(doc, observer, steering, profiles, context, output)
            page.refresh()
        doc.add_periodic_callback(page.refresh, FRAME_MS)

    return make
