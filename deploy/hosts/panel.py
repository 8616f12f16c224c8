"""The panel of `tis up` in a terminal, or lines elsewhere: state of the three sides, from their events, and view."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, get_args

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from tis.common.channels import Direction, Side
from tis.common.runtime.status import warning_line
from tis.deploy.shell.outcome import Event

_MAX_WARNINGS: Final = 5
_LINE_EVERY_S: Final = 5.0
_DEAD: Final = ("failed", "exit", "gone")
_SHOWN: Final[Mapping[Side, Mapping[str, str]]] = {
    "surgeon": {"sent": "sent", "ticks_missed": "ticks missed"},
    "netem": {"lost": "lost", "ticks_missed": "ticks missed"},
    "patient": {"received": "received", "estimates": "estimates", "ticks_missed": "ticks missed"},
}
"""Counters of each side, and their names in words."""


@dataclass
class SideState:
    """A side in the panel: its host, its state in words, and its last counters."""

    place: str
    state: str = "starting"
    kind: str = "starting"
    now_s: float = 0.0
    counters: dict[str, int] = field(default_factory=dict)


class PanelState:
    """The states of the three sides; no clock, no terminal."""

    def __init__(self, places: Mapping[Side, str], duration_s: float) -> None:
        self.duration_s: Final = duration_s
        self.sides: Final[dict[Side, SideState]] = {side: SideState(places[side]) for side in get_args(Side)}
        self.warnings: Final[deque[str]] = deque(maxlen=_MAX_WARNINGS)
        self.has_begun = False
        self._next_line_s = 0.0

    @property
    def now_s(self) -> float:
        """The run time that any side has reached, at most the run's duration."""
        return min(max(side.now_s for side in self.sides.values()), self.duration_s)

    def goes_on(self, side: Side) -> bool:
        """Tell whether the run still goes on for a side that died, so that it has something to come back to."""
        kinds = {name: state.kind for name, state in self.sides.items()}
        has_network = side == "netem" or kinds["netem"] not in _DEAD
        return self.has_begun and has_network and "ended" not in kinds.values()

    def take(self, event: Event) -> list[str]:
        """Take an event in; return the lines that a terminal without a panel prints for it."""
        side, kind = event["side"], event["event"]
        state = self.sides[side]
        if kind == "progress":
            state.now_s, state.counters = event["now_s"], event["counters"]
            state.state = f"running at {self._at(state)}"
            return self._progress_line()
        if kind in ("warning", "output"):
            said = (
                warning_line(event.get("warning", ""), event.get("kind"))
                if kind == "warning"
                else event.get("text", "")
            )
            text = f"{side}: {said}"
            self.warnings.append(text)
            return [text]
        words = _words(event, state)
        if words is None or words == state.state:
            return []
        state.state, state.kind = words, "ended" if words == "ended" else kind
        self.has_begun = self.has_begun or kind == "running"
        return [f"{side} ({state.place}): {words}"]

    def counts(self, side: Side) -> str:
        """Return a side's counters in words."""
        counters = self.sides[side].counters
        shown: dict[str, int | str] = dict(counters)
        if any(".dropped" in name for name in counters):
            there, back = (
                sum(n for name, n in counters.items() if name.startswith(f"{way}.dropped"))  # by cause
                for way in get_args(Direction)
            )
            shown["lost"] = f"{there} there, {back} back"
        return "  ".join(f"{words} {shown[name]}" for name, words in _SHOWN[side].items() if name in shown)

    def _at(self, state: SideState) -> str:
        return f"{min(max(state.now_s, 0.0), self.duration_s):.0f} of {self.duration_s:g} s"

    def _progress_line(self) -> list[str]:
        if self.now_s < self._next_line_s:
            return []
        self._next_line_s = self.now_s + _LINE_EVERY_S
        counts = "  ".join(filter(None, map(self.counts, self.sides)))
        return [f"{self.now_s:4.0f}/{self.duration_s:g} s  {counts}"]


def _words(event: Event, state: SideState) -> str | None:
    """Return a side's state after an event; None for one that changes nothing."""
    kind = event["event"]
    if state.kind == "ending" and kind in ("failed", "exit"):
        return "ended"  # it was told to: no failure
    if kind == "exit":
        if state.kind in ("ended", "failed") or event["code"] == 0:
            return None  # it said so itself
        return f"killed by signal {-event['code']}" if event["code"] < 0 else f"failed with exit code {event['code']}"
    return {
        "waiting": f"waiting for {event.get('whom')}",
        "ready": "ready",
        "running": "running",
        "ending": "ending",
        "ended": "ended",
        "failed": f"failed: {'; '.join(event.get('reasons', ()))}",
        "restarted": f"died, started again ({event.get('n')})",
        "gone": f"gone: {event.get('text')}",
    }.get(kind)


_REFRESH_HZ: Final = 4
_MAX_WIDTH: Final = 100
_STYLES: Final = {
    "ready": "green", "running": "green", "ended": "green", "failed": "red", "exit": "red", "gone": "red",
}  # fmt: skip


class PanelView:
    """Shows the events of the sides."""

    def __init__(self, console: Console, state: PanelState, title: str) -> None:
        self._console = console
        self._state = state
        self._title = title
        self._live: Live | None = None

    def start(self) -> None:
        """Open the panel, in a terminal."""
        if self._console.is_terminal:
            self._live = Live(
                console=self._console, get_renderable=self._panel, refresh_per_second=_REFRESH_HZ, transient=True
            )
            self._live.start()

    def take(self, event: Event) -> None:
        """Show an event."""
        lines = self._state.take(event)
        stays = event["event"] in ("warning", "output", "failed", "restarted", "gone", "exit")
        for line in lines if self._live is None or stays else ():
            style = "yellow" if stays else "dim"
            self._console.print(line, style=style, highlight=False, markup=False, soft_wrap=True)

    def stop(self) -> None:
        """Close the panel; a second call does nothing."""
        if self._live is not None:
            self._live.stop()
            self._live = None

    def _panel(self) -> RenderableType:
        state = self._state
        sides = Table.grid(padding=(0, 2))
        for side, one in state.sides.items():
            style = _STYLES.get(one.kind, "yellow")
            sides.add_row(side, Text(one.place), Text(one.state, style=style), Text(state.counts(side)))
        bar = Table.grid(expand=True)
        bar.add_row(ProgressBar(total=state.duration_s, completed=state.now_s))
        parts: list[RenderableType] = [bar, sides]
        parts += [Text(text, style="yellow") for text in state.warnings]
        head = f"{self._title}  {state.now_s:.0f} of {state.duration_s:g} s"
        width = min(self._console.width, _MAX_WIDTH)
        return Panel(Group(*parts), title=Text(head), title_align="left", expand=False, width=width)
