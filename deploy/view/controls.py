"""Controls of the page: widgets that send requests to netem, and the line with the answer."""

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

from tis.deploy.view.steering import Steering

_DIRECTIONS: Final[list[str | tuple[Any, str]]] = [
    ("both", "both ways"),
    ("forward", "to the patient"),
    ("feedback", "back"),
]
_BOTTOM_ALIGNED: Final = {"align-items": "end", "align-self": "end"}
_WRAPPING: Final = {"flex-wrap": "wrap", "gap": "6px 8px"}
_MAX_OUTAGE_MS: Final = 60_000
_MAX_DELAY_MS: Final = 10_000


class Controls:
    """Widgets that change the network from one page; enabled while netem is present."""

    def __init__(
        self, doc: Document, steering: Steering, profiles: Sequence[str], style_sheet: InlineStyleSheet
    ) -> None:
        self._doc = doc
        self._steering = steering
        self.style: Final = InlineStyleSheet(css=Path(__file__).with_name("controls.css").read_text(encoding="utf-8"))
        self.widgets: Final[list[Button | Select | NumericInput]] = []
        self.direction: Final = self._select("Which way", list(_DIRECTIONS), "both", 126)
        names: list[str | tuple[Any, str]] = [*profiles]
        self.outage_ms: Final = self._number("Outage, ms", 1000, 1, _MAX_OUTAGE_MS)
        self.delay_ms: Final = self._number("Delay, ms", 100, 0, _MAX_DELAY_MS)
        self.loss_pct: Final = self._number("Loss, %", 5, 0, 100)
        self.profile: Final = self._select("Profile (both ways)", names, profiles[0], 190)
        self.answer: Final = Div(text="", stylesheets=[style_sheet], sizing_mode="stretch_width")
        self.layout: Final[LayoutDOM] = self._lay_out()
        self.enable(False)

    def enable(self, usable: bool) -> None:
        """Enable or disable all controls."""
        for widget in self.widgets:
            if widget.disabled == usable:
                widget.disabled = not usable

    def _lay_out(self) -> LayoutDOM:
        """Return the controls in reading order; the order of creation is the order of the tab key."""
        stops = (
            self._button("Stop the arms", "danger", 112, self._steering.stop),
            self._button("Release", "default", 78, self._steering.release),
        )
        rows = [
            row(*stops, styles=_BOTTOM_ALIGNED),
            row(self.direction, styles=_BOTTOM_ALIGNED),
            row(self.outage_ms, self._button("Cause an outage", "danger", 134, self._outage), styles=_BOTTOM_ALIGNED),
            row(self.delay_ms, self._button("Set delay", "primary", 90, self._delay), styles=_BOTTOM_ALIGNED),
            row(self.loss_pct, self._button("Set loss", "primary", 82, self._loss), styles=_BOTTOM_ALIGNED),
            row(self.profile, self._button("Use profile", "primary", 98, self._profile), styles=_BOTTOM_ALIGNED),
            row(self._button("Reset", "default", 70, self._steering.reset), styles=_BOTTOM_ALIGNED),
        ]
        return row(*rows, styles=_WRAPPING, sizing_mode="stretch_width")

    def _button(self, label: str, kind: Any, width: int, act: Callable[[Callable[[str], None]], None]) -> Button:
        button = Button(label=label, button_type=kind, width=width, stylesheets=[self.style])
        button.on_click(lambda: self._submit(label, act))
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

    def _submit(self, label: str, act: Callable[[Callable[[str], None]], None]) -> None:
        self._show_answer(f"{label}: sent …")

        def on_answer(text: str) -> None:
            # called from the thread of the requests; a closed page never runs the callback
            self._doc.add_next_tick_callback(partial(self._show_answer, f"{label}: {text}"))

        act(on_answer)

    def _show_answer(self, text: str) -> None:
        self.answer.text = f"<p>{escape(text)}</p>"

    def _outage(self, on_answer: Callable[[str], None]) -> None:
        self._steering.outage(self.direction.value, float(self.outage_ms.value or 1), on_answer)

    def _delay(self, on_answer: Callable[[str], None]) -> None:
        self._steering.set_stage(
            self.direction.value, f"delay.delay_ms={float(self.delay_ms.value or 0):g}", on_answer
        )

    def _loss(self, on_answer: Callable[[str], None]) -> None:
        self._steering.set_stage(
            self.direction.value, f"loss.p_loss={float(self.loss_pct.value or 0) / 100:g}", on_answer
        )

    def _profile(self, on_answer: Callable[[str], None]) -> None:
        self._steering.profile(self.profile.value, on_answer)
