"""What `tis run` shows while it runs: a bar in a terminal, a line every few seconds elsewhere."""

from typing import Any, Final

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn

_LINE_EVERY_S: Final = 5.0


class RunProgress:
    """Turns the children's events into what a person sees."""

    def __init__(self, console: Console, duration_s: float) -> None:
        self._console = console
        self._duration_s = duration_s
        self._counters: dict[str, dict[str, int]] = {}
        self._ready: set[str] = set()
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.fields[news]}"),
            console=console,
            refresh_per_second=2,
        )
        self._task: TaskID | None = None
        self._next_line_s = 0.0
        self.began = False

    def start(self) -> None:
        """Say that the sides are being started."""
        self._console.print("starting surgeon, netem and patient", style="dim")

    def take(self, event: dict[str, Any]) -> None:
        """Show one event of a child."""
        side, kind = event["side"], event["event"]
        if kind == "warning":
            text = f"{side}: warning: {event['warning']}"
            self._console.print(text, style="yellow", highlight=False, markup=False, soft_wrap=True)
        elif kind == "ready":
            self._ready.add(side)
            self._console.print(f"{side} is ready", style="dim")
        elif kind == "running":
            self._begin()
        elif kind == "progress":
            self._counters[side] = event["counters"]
            if side == "patient":
                self._advance(event["now_s"])

    def stop(self) -> None:
        """Leave the terminal as it was."""
        if self._task is not None:
            self._bar.stop()

    def _begin(self) -> None:
        if self._console.is_terminal and not self.began:
            self._task = self._bar.add_task("running", total=self._duration_s, news="")
            self._bar.start()
        self.began = True

    def _advance(self, now_s: float) -> None:
        done_s = min(now_s, self._duration_s)
        news = f"{done_s:4.0f} of {self._duration_s:g} s  {self._news()}"
        if self._task is not None:
            self._bar.update(self._task, completed=done_s, news=news)
        elif now_s >= self._next_line_s:
            self._next_line_s += _LINE_EVERY_S
            self._console.print(news, highlight=False)

    def _news(self) -> str:
        surgeon, netem, patient = (self._counters.get(side, {}) for side in ("surgeon", "netem", "patient"))
        dropped = sum(n for name, n in netem.items() if name.startswith("forward.dropped"))
        return (
            f"sent {surgeon.get('sent', 0)}  lost {dropped}  under way {netem.get('forward.held_at_end', 0)}  "
            f"received {patient.get('received', 0)}  estimates {patient.get('estimates', 0)}  "
            f"ticks missed {patient.get('ticks_missed', 0)}"
        )
