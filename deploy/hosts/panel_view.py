"""The panel of `tis up` in a terminal, or lines elsewhere."""

from typing import Final

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from tis.deploy.hosts.panel import PanelState
from tis.deploy.shell.outcome import Event

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
