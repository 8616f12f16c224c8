"""The page's controls: widgets that ask netem, and the line that says what came of it."""

from collections.abc import Callable, Sequence
from functools import partial
from html import escape
from pathlib import Path
from typing import Any, Final

from bokeh.document import Document
from bokeh.layouts import row
from bokeh.models import InlineStyleSheet, LayoutDOM
from bokeh.models.widgets.buttons import Button
from bokeh.models.widgets.inputs import NumericInput, Select
from bokeh.models.widgets.markups import Div

from deploy.view.steering import Steering

_DIRECTIONS: Final[list[str | tuple[Any, str]]] = [
    ("both", "both ways"),
    ("forward", "to the patient"),
    ("feedback", "back"),
]
_AT_THE_FOOT: Final = {"align-items": "end", "align-self": "end"}
_WRAPPING: Final = {"flex-wrap": "wrap", "gap": "6px 8px"}
_LONGEST_OUTAGE_MS: Final = 60_000
_MOST_DELAY_MS: Final = 10_000


class Controls:
    """Everything that changes the network from one page; it can be used while netem is there to be asked."""

    def __init__(self, doc: Document, steering: Steering, profiles: Sequence[str], words: InlineStyleSheet) -> None:
        self._doc = doc
        self._steering = steering
        self.style: Final = InlineStyleSheet(css=Path(__file__).with_name("controls.css").read_text(encoding="utf-8"))
        self.widgets: Final[list[Button | Select | NumericInput]] = []
        self.direction: Final = self._select("Which way", list(_DIRECTIONS), "both", 126)
        names: list[str | tuple[Any, str]] = [*profiles]
        self.outage_ms: Final = self._number("Outage, ms", 1000, 1, _LONGEST_OUTAGE_MS)
        self.delay_ms: Final = self._number("Delay, ms", 100, 0, _MOST_DELAY_MS)
        self.loss_pct: Final = self._number("Loss, %", 5, 0, 100)
        self.profile: Final = self._select("Profile (both ways)", names, profiles[0], 190)
        self.answer: Final = Div(text="", stylesheets=[words], sizing_mode="stretch_width")
        self.layout: Final[LayoutDOM] = self._lay_out()
        self.enable(False)

    def enable(self, usable: bool) -> None:
        """Let the controls be used, or not."""
        for widget in self.widgets:
            if widget.disabled == usable:
                widget.disabled = not usable

    def _lay_out(self) -> LayoutDOM:
        """Return the controls in the order in which they are read and tabbed through; made so, they are used so."""
        rows = [
            row(self.direction, styles=_AT_THE_FOOT),
            row(self.outage_ms, self._button("Cause an outage", "danger", 134, self._outage), styles=_AT_THE_FOOT),
            row(self.delay_ms, self._button("Set delay", "primary", 90, self._delay), styles=_AT_THE_FOOT),
            row(self.loss_pct, self._button("Set loss", "primary", 82, self._loss), styles=_AT_THE_FOOT),
            row(self.profile, self._button("Use profile", "primary", 98, self._profile), styles=_AT_THE_FOOT),
            row(self._button("Reset", "default", 70, self._reset), styles=_AT_THE_FOOT),
        ]
        return row(*rows, styles=_WRAPPING, sizing_mode="stretch_width")

    def _button(self, label: str, kind: Any, width: int, act: Callable[[Callable[[str], None]], None]) -> Button:
        button = Button(label=label, button_type=kind, width=width, stylesheets=[self.style])
        button.on_click(lambda: self._ask(label, act))
        self.widgets.append(button)
        return button

    def _select(self, title: str, options: list[str | tuple[Any, str]], value: str, width: int) -> Select:
        select = Select(title=title, options=options, value=value, width=width, stylesheets=[self.style])
        self.widgets.append(select)
        return select

    def _number(self, title: str, value: float, low: float, high: float) -> NumericInput:
        number = NumericInput(
            title=title, value=value, low=low, high=high, mode="float", width=76, stylesheets=[self.style]
        )
        self.widgets.append(number)
        return number

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
