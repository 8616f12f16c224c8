"""Progress display of `tis run`: a panel in a terminal, a line every few seconds elsewhere."""

from collections import deque
from collections.abc import Callable, Mapping
from math import inf
from textwrap import fill
from typing import Any, Final, NamedTuple, get_args

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from tis.common.channels import Direction, Side
from tis.common.runtime.status import warning_line
from tis.deploy.watch.book import WINDOW_S
from tis.deploy.watch.live_figures import CrossingFigures, LiveFigures

_LINE_EVERY_S: Final = 5.0
_BEHIND_S: Final = 2.0
_BEHIND: Final = "the observer is behind: the machine is busy, and the run's own figures come at its end"
_REFRESH_HZ: Final = 4
_STATE_STYLES: Final[Mapping[str, str]] = {"running": "green", "ready": "green", "done": "green", "failed": "red"}
_MAX_WIDTH: Final = 88
_LINE_WIDTH: Final = 80
_NO_VALUE: Final = "-"
_ON_THE_LINE: Final = ("sent", "lost", "received", "ticks missed")
_MAX_STATUSES: Final = 8


class _Status(NamedTuple):
    """A side's counters at an instant of run time."""

    now_s: float
    counters: dict[str, int]


class RunProgress:
    """Displays the events of the child processes and the figures of an observer (``look``)."""

    def __init__(
        self, console: Console, duration_s: float, title: str = "", look: Callable[[], LiveFigures] = LiveFigures
    ) -> None:
        self._console = console
        self._duration_s = duration_s
        self._title = title
        self._look = look
        self._statuses: dict[Side, deque[_Status]] = {side: deque(maxlen=_MAX_STATUSES) for side in get_args(Side)}
        self._states: dict[Side, str] = dict.fromkeys(get_args(Side), "starting")
        self._now_s = 0.0
        self._next_line_s = 0.0
        self._live: Live | None = None
        self.began = False
        self.told: Final[set[str]] = set()
        self._ending = False

    def start(self) -> None:
        """Print that the sides are starting and open the panel."""
        self._console.print("starting surgeon, netem and patient", style="dim")
        if self._console.is_terminal:
            self._live = Live(
                console=self._console, get_renderable=self._panel, refresh_per_second=_REFRESH_HZ, transient=True
            )
            self._live.start()

    def take(self, event: dict[str, Any]) -> None:
        """Show one event of a child."""
        side, kind = event["side"], event["event"]
        if kind == "warning":
            self.told.add(event["warning"])
            text = f"{side}: {warning_line(event['warning'], event.get('kind'))}"
            self._console.print(text, style="yellow", highlight=False, markup=False, soft_wrap=True)
        elif kind == "waiting":
            self._states[side] = f"waiting for {event['whom']}"
        elif kind == "ready":
            self._states[side] = "ready"
            self._console.print(f"{side} is ready", style="dim")
        elif kind == "running":
            self._states[side] = "running"
            self.began = True
        elif kind == "ending":
            self._states[side], self._ending = "ending", True
        elif kind in ("ended", "failed"):
            # after Ctrl-C it is no failure that a side has gone
            self._states[side] = "done" if kind == "ended" or self._ending else "failed"
            if event.get("counters"):
                self._statuses[side].append(_Status(inf, event["counters"]))
        elif kind == "progress":
            self._statuses[side].append(_Status(event["now_s"], event["counters"]))
            if side == "patient":
                self._advance(event["now_s"])

    def stop(self) -> None:
        """Close the panel; a second call does nothing."""
        if self._live is not None:
            self._live.stop()
            self._live = None

    def _advance(self, now_s: float) -> None:
        self._now_s = min(now_s, self._duration_s)
        if self._live is None and now_s >= self._next_line_s:
            self._next_line_s += _LINE_EVERY_S
            self._console.print(self._line(), highlight=False, soft_wrap=True)

    def _line(self) -> str:
        """Return the counts and, on a second line, the last figures; what is longer than 80 columns goes on below."""
        counts = self._counts()
        shown = "  ".join(f"{name} {counts[name]}" for name in _ON_THE_LINE)
        line, found = f"{self._now_s:4.0f}/{self._duration_s:g} s  {shown}", self._look()
        figures = _brief(found) if self._is_timely(found) else _BEHIND
        over = "so far" if self._now_s < WINDOW_S else f"last {WINDOW_S} s"
        lines = [line, f"  {over}: {figures}"] if figures else [line]
        return "\n".join(fill(each, _LINE_WIDTH, subsequent_indent="    ") for each in lines)

    def _is_timely(self, found: LiveFigures) -> bool:
        """Tell whether the observer has come to these seconds, or, on a busy machine, still reads earlier ones."""
        return not found.now_s or self._now_s - found.now_s <= _BEHIND_S

    def _counters(self) -> dict[Side, dict[str, int] | None]:
        """Return each side's counters, none later than those of the side before it.

        The sides report at different instants; with this order nothing is shown as received before it was sent.
        """
        found: dict[Side, dict[str, int] | None] = {}
        latest_s = inf
        for side in get_args(Side):  # the order in which a command passes the sides
            known = next((one for one in reversed(self._statuses[side]) if one.now_s <= latest_s), None)
            found[side] = None if known is None else known.counters
            latest_s = latest_s if known is None else known.now_s
        return found

    def _counts(self) -> dict[str, str]:
        shown = self._counters()

        def count(side: Side, *names: str) -> str:
            counters = shown[side]
            return _NO_VALUE if counters is None else str(sum(counters.get(name, 0) for name in names))

        there, back = (
            count("netem", *(name for name in shown["netem"] or () if name.startswith(f"{way}.dropped")))
            for way in get_args(Direction)
        )
        missed = [counters.get("ticks_missed", 0) for counters in shown.values() if counters is not None]
        return {
            "sent": count("surgeon", "sent"),
            "lost": _NO_VALUE if shown["netem"] is None else f"{there} there, {back} back",
            "under way": count("netem", "forward.held_at_end") + " there",
            "received": count("patient", "received"),
            "estimates": count("patient", "estimates"),
            "ticks missed": str(sum(missed)) if missed else _NO_VALUE,
        }

    def _panel(self) -> RenderableType:
        counts, counters = self._counts(), self._counters()
        shown: dict[Side, tuple[str, ...]] = {
            "surgeon": ("sent",),
            "netem": ("lost", "under way"),
            "patient": ("received", "estimates"),
        }
        sides = Table.grid(padding=(0, 2))
        for side, state in self._states.items():
            its = counters[side]
            missed = None if its is None else its.get("ticks_missed")
            words = [f"{name} {counts[name]}" for name in shown[side]]
            words += [] if missed is None else [f"ticks missed {missed}"]
            style = _STATE_STYLES.get(state, "yellow")
            sides.add_row(side, Text(state, style=style), "" if its is None else "  ".join(words))
        figures = Table.grid(padding=(0, 2))
        found = self._look()
        for name, text in (figure_texts(found) if self._is_timely(found) else {"not shown": _BEHIND}).items():
            figures.add_row(name, text)
        bar = Table.grid(expand=True)  # a bare ProgressBar does not end its line
        bar.add_row(ProgressBar(total=self._duration_s, completed=self._now_s))
        parts: list[RenderableType] = [bar, sides]
        if figures.row_count:
            parts += [Text(f"in the last {WINDOW_S} s", style="dim"), figures]
        head = f"{self._title}  {self._now_s:.0f} of {self._duration_s:g} s".strip()
        return Panel(
            Group(*parts),
            title=Text(head),
            title_align="left",
            expand=False,
            width=min(self._console.width, _MAX_WIDTH),
        )


def figure_texts(found: LiveFigures) -> dict[str, str]:
    """Return latency, loss and accuracy as text, as far as they are known."""
    texts = {}
    if found.end_to_end_p50_ms is not None:
        arm, answers = found.streams.get("arm", CrossingFigures()), found.streams.get("answers", CrossingFigures())
        texts["end to end"] = f"median {found.end_to_end_p50_ms:.1f} ms, p99 {_ms(found.end_to_end_p99_ms)}"
        texts["end to end"] += ", from a new sample to its estimate"
        texts["one way"] = f"median {_ms(arm.delay_p50_ms)} of all arm positions, back {_ms(answers.delay_p50_ms)}"
        there, back = _losses_pct(found)
        texts["loss"] = found.limit_text or f"{_pct(there)} of all poses to the patient, {_pct(back)} back"
    if found.rmse_mm is not None:
        ratio = found.ratio_to_hold
        of_hold = "" if ratio is None else f", {100 * ratio:.0f} % of the {found.hold_rmse_mm:.2f} mm of hold"
        texts["error"] = f"RMSE {found.rmse_mm:.2f} mm{of_hold}"
    return texts


def _brief(found: LiveFigures) -> str:
    """Return the main figures as a short text, as far as they are known."""
    parts = []
    if found.end_to_end_p50_ms is not None:
        most = "" if found.end_to_end_p99_ms is None else f", p99 {_short(found.end_to_end_p99_ms, 100)}"
        parts = [f"latency p50 {_short(found.end_to_end_p50_ms, 100)}{most} ms", _loss(found)]
    if found.rmse_mm is not None:
        parts.append(f"RMSE {_short(found.rmse_mm, 100, 2)} mm")
    return "; ".join(parts)


def _losses_pct(found: LiveFigures) -> tuple[float | None, float | None]:
    """Return the loss there, of commands and arm positions together, and back, of estimates."""
    return found.loss_pct("master", "arm"), found.loss_pct("answers")


def _loss(found: LiveFigures) -> str:
    if not found.keeps_up:
        return "loss not seen: the observer cannot keep up"
    there, back = _losses_pct(found)
    if there is None:
        return f"loss {_NO_VALUE}" if back is None else f"loss back {_short(back, 10)} %"
    if there == _ALL_PCT:  # an outage, or a machine that stands still: the observer cannot tell
        return "none came" + (" there" if back is None else f", back {_short(back, 10)} %")
    return f"loss {_short(there, 10)} %" + (" there" if back is None else f", back {_short(back, 10)} %")


_ALL_PCT: Final = 100.0


def _short(value: float, many: float, n_digits: int = 1) -> str:
    """Return a value with ``n_digits`` decimals, one fewer from ``many`` on: the line is short."""
    return f"{value:.{n_digits - (value >= many)}f}"


def _ms(value: float | None) -> str:
    return _NO_VALUE if value is None else f"{value:.1f} ms"


def _pct(value: float | None) -> str:
    return _NO_VALUE if value is None else f"{value:.1f} %"
