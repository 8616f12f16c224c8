"""The page's controls: widgets that ask netem, and the line that says what came of it."""

from collections.abc import Callable, Sequence
from functools import partial
from html import escape
from typing import Any, Final

from bokeh.document import Document
from bokeh.layouts import column, row
from bokeh.models import InlineStyleSheet, LayoutDOM
from bokeh.models.widgets.buttons import Button
from bokeh.models.widgets.inputs import Select, Spinner
from bokeh.models.widgets.markups import Div

from deploy.view.steering import Steering

_DIRECTIONS: Final[list[str | tuple[Any, str]]] = [
    ("both", "both ways"),
    ("forward", "to the patient"),
    ("feedback", "back to the surgeon"),
]
_AT_THE_FOOT: Final = {"align-items": "end"}
_WRAPPING: Final = {"flex-wrap": "wrap", "gap": "4px 20px"}
_LONGEST_OUTAGE_MS: Final = 60_000
_MOST_DELAY_MS: Final = 10_000


class Controls:
    """Everything that changes the network from one page."""

    def __init__(self, doc: Document, steering: Steering, profiles: Sequence[str], style: InlineStyleSheet) -> None:
        self._doc = doc
        self._steering = steering
        self.direction: Final = Select(title="Which way", options=list(_DIRECTIONS), value="both", width=150)
        names: list[str | tuple[Any, str]] = [*profiles]
        self.outage_ms: Final = _spinner("Outage, ms", 1000, 1, _LONGEST_OUTAGE_MS, 100)
        self.delay_ms: Final = _spinner("Delay, ms", 100, 0, _MOST_DELAY_MS, 10)
        self.loss_pct: Final = _spinner("Loss, %", 5, 0, 100, 1)
        self.profile: Final = Select(title="Profile (both ways)", options=names, value=profiles[0], width=170)
        self.answer: Final = Div(text="", stylesheets=[style], sizing_mode="stretch_width", css_classes=["answer"])
        self.layout: Final[LayoutDOM] = self._lay_out()

    def _lay_out(self) -> LayoutDOM:
        outage = self._button("Cause an outage", "danger", self._outage)
        delay = self._button("Set delay", "primary", self._delay)
        loss = self._button("Set loss", "primary", self._loss)
        profile = self._button("Use profile", "primary", self._profile)
        reset = self._button("Reset", "default", self._reset)
        pairs = (
            (self.outage_ms, outage), (self.delay_ms, delay), (self.loss_pct, loss), (self.profile, profile),
        )  # fmt: skip
        rows = [row(one, two, styles=_AT_THE_FOOT) for one, two in pairs]
        first = row(self.direction, reset, styles=_AT_THE_FOOT)
        grid = row(first, *rows, styles=_WRAPPING, sizing_mode="stretch_width")
        return column(grid, self.answer, sizing_mode="stretch_width")

    def _button(self, label: str, kind: Any, act: Callable[[Callable[[str], None]], None]) -> Button:
        button = Button(label=label, button_type=kind, width=125)
        button.on_click(lambda: self._ask(label, act))
        return button

    def _ask(self, label: str, act: Callable[[Callable[[str], None]], None]) -> None:
        self._say(f"{label}: asked …")

        def tell(text: str) -> None:
            # from the thread of the requests; a page that is gone by then has no more turns
            self._doc.add_next_tick_callback(partial(self._say, f"{label}: {text}"))

        act(tell)

    def _say(self, text: str) -> None:
        self.answer.text = f"<p>{escape(text)}</p>"

    def _outage(self, tell: Callable[[str], None]) -> None:
        self._steering.outage(self.direction.value, float(self.outage_ms.value or 1), tell)

    def _delay(self, tell: Callable[[str], None]) -> None:
        self._steering.set_stage(self.direction.value, f"delay.delay_ms={float(self.delay_ms.value or 0):g}", tell)

    def _loss(self, tell: Callable[[str], None]) -> None:
        self._steering.set_stage(self.direction.value, f"loss.p_loss={float(self.loss_pct.value or 0) / 100:g}", tell)

    def _profile(self, tell: Callable[[str], None]) -> None:
        self._steering.profile(self.profile.value, tell)

    def _reset(self, tell: Callable[[str], None]) -> None:
        self._steering.reset(tell)


def _spinner(title: str, value: float, low: float, high: float, step: float) -> Spinner:
    return Spinner(title=title, value=value, low=low, high=high, step=step, width=100)
