"""One page: its figures, numbers and controls put together, and refreshed from the book at its own pace."""

from collections.abc import Callable
from pathlib import Path
from typing import Final

from bokeh.document import Document
from bokeh.models import InlineStyleSheet, Model
from bokeh.models.widgets.inputs import Select
from bokeh.models.widgets.markups import Div

from deploy.report.palette import Tone
from deploy.report.plot_style import THEME
from deploy.view.controls import Controls
from deploy.view.feed import Feed
from deploy.view.plots import ESTIMATE, HOLD, LOST, STREAM_TONES, TRUTH, Plots
from deploy.view.steering import Steering
from deploy.view.words import figures_html, run_text, sides_html, state_html
from deploy.watch.book import WINDOW_S
from deploy.watch.observer import Observer

FRAME_MS: Final = 200
_WORDS_EVERY: Final = 2
_STATE_EVERY: Final = 5
_HERE: Final = Path(__file__).parent


class Page:
    """What one browser sees. Bokeh awaits each frame's being written before it asks for the next one."""

    def __init__(self, doc: Document, observer: Observer, steering: Steering, profiles: list[str]) -> None:
        self._doc = doc
        self._observer = observer
        self._steering = steering
        self._feed = Feed()
        self._n_frames = 0
        style = InlineStyleSheet(css=(_HERE / "words.css").read_text(encoding="utf-8"))
        self._plots = Plots()
        self._sides = Div(stylesheets=[style], sizing_mode="stretch_width")
        self._figures = Div(stylesheets=[style], sizing_mode="stretch_width")
        self._state = Div(stylesheets=[style], sizing_mode="stretch_width")
        self._arm = Select(title="Arm", options=[], visible=False, width=120)
        self._arm.on_change("value", lambda _attr, _old, new: self._choose(new))
        controls = Controls(doc, steering, profiles, style)
        roots: dict[str, Model] = {
            **self._plots.roots(), "sides": self._sides, "figures": self._figures, "state": self._state,
            "arm": self._arm, "controls": controls.layout,
        }  # fmt: skip
        for name, model in roots.items():
            model.name = name
            doc.add_root(model)

    def refresh(self) -> None:
        """Draw what is new; words change less often than lines."""
        frame = self._observer.read(self._feed.advance)
        self._plots.show(frame)
        if list(frame.arms) != self._arm.options:
            self._arm.update(options=list(frame.arms), value=frame.arm, visible=len(frame.arms) > 1)
        if self._n_frames % _WORDS_EVERY == 0:
            there = self._observer.attendance()
            figures, n_absent = self._observer.read(lambda book: (book.figures(), book.n_ticks_absent))
            self._sides.text = sides_html(there, frame.now_s)
            self._figures.text = figures_html(figures, n_absent)
            title = f"tis live: {run_text(there, frame.now_s)}"
            if self._doc.title != title:
                self._doc.title = title
        if self._n_frames % _STATE_EVERY == 0 and "netem" in self._observer.attendance().present:
            self._state.text = state_html(self._steering.state())
        self._n_frames += 1

    def _choose(self, arm: str) -> None:
        self._feed.arm = arm


def pages(observer: Observer, steering: Steering, profiles: list[str]) -> Callable[[Document], None]:
    """Return what makes a page for each browser."""
    template = (_HERE / "page.html").read_text(encoding="utf-8")
    css = (_HERE / "page.css").read_text(encoding="utf-8")
    tones: dict[str, Tone] = {"truth": TRUTH, "estimate": ESTIMATE, "hold": HOLD, "lost": LOST}
    tones |= {str(name): tone for name, tone in STREAM_TONES.items()}

    def make(doc: Document) -> None:
        doc.theme = THEME
        doc.title = "tis live"
        doc.template = template  # type: ignore[assignment]  # Bokeh takes text, too, and puts its base beneath
        doc.template_variables.update(
            css=css, tones={name: tone.light for name, tone in tones.items()}, window_s=WINDOW_S
        )
        page = Page(doc, observer, steering, profiles)
        page.refresh()
        doc.add_periodic_callback(page.refresh, FRAME_MS)

    return make
