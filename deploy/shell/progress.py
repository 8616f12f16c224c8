"""Progress of a long command: bars in a terminal, a line every few seconds elsewhere."""

import time
from collections.abc import Callable
from typing import Final, Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from tis.common.units import NS_PER_S

_LINE_EVERY_S: Final = 10.0
_FEW: Final = 3
"""Parts from which on a rate is stated."""


def length_text(length_s: float) -> str:
    """Return a length of time in round words."""
    return f"{length_s:.0f} s" if length_s < 100 else f"{length_s / 60:.0f} min"


class PhaseProgress:
    """Progress through named phases, each of which counts its own parts.

    A phase is shown from its first `total` on. Without a terminal, `wait` prints a line when one is due; it must be
    called at least every few seconds. ``in_rounds``: what is found decides how many parts follow, so the time left
    is that of the parts known so far.
    """

    def __init__(
        self, console: Console, now_s: Callable[[], float] = time.monotonic, in_rounds: bool = False
    ) -> None:
        self._console = console
        self._in_rounds = in_rounds
        self._now_s = now_s
        self._begun_s = now_s()
        self._next_line_s = _LINE_EVERY_S
        self._done: dict[str, int] = {}
        self._totals: dict[str, int] = {}
        # Of each phase the instant and the count at which its first parts were done: the rate counts from there.
        self._first: dict[str, tuple[float, int]] = {}
        self._bars: Progress | None = None
        self._bar_of: dict[str, TaskID] = {}

    def __enter__(self) -> Self:
        if self._console.is_terminal:
            columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
            times = (TimeElapsedColumn(), *(() if self._in_rounds else (TimeRemainingColumn(),)))
            self._bars = Progress(*columns, *times, console=self._console, transient=True)
            self._bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._bars is not None:
            self._bars.stop()

    def total(self, phase: str, n_parts: int, n_done: int = 0) -> None:
        """Show a phase of ``n_parts``, of which ``n_done`` were done before, or add that to one that is shown."""
        self._totals[phase] = self._totals.get(phase, 0) + n_parts
        self._done[phase] = self._done.get(phase, 0) + n_done
        if self._bars is not None and phase not in self._bar_of:
            self._bar_of[phase] = self._bars.add_task(phase)
        if self._bars is not None:
            self._bars.update(self._bar_of[phase], total=self._totals[phase])
        self.advance(phase, 0)

    def advance(self, phase: str, n_parts: int = 1) -> None:
        """Count parts of a phase that are done."""
        self._done[phase] += n_parts
        if n_parts and phase not in self._first:
            self._first[phase] = self._now_s(), self._done[phase]
        if self._bars is not None:
            self._bars.update(self._bar_of[phase], completed=self._done[phase])
        self.wait()

    def wait(self) -> None:
        """Print a line when it is due, unless there are bars."""
        passed_s = self._now_s() - self._begun_s
        if self._bars is None and passed_s >= self._next_line_s:
            self._next_line_s = passed_s + _LINE_EVERY_S
            counts = ", ".join(f"{phase} {self._done[phase]}/{total}" for phase, total in self._totals.items())
            self._console.print(f"{passed_s:4.0f} s  {counts}{self._left()}", highlight=False, soft_wrap=True)

    @property
    def passed_s(self) -> float:
        """Return the time since the command began, in s."""
        return self._now_s() - self._begun_s

    def tell(self, text: str) -> None:
        """Print at once what is known so far."""
        passed_s = self._now_s() - self._begun_s
        self._console.print(f"{passed_s:4.0f} s  {text}", highlight=False, markup=False, soft_wrap=True)

    def _left(self) -> str:
        """Return about how long the last phase takes on; empty before its rate is known."""
        phase = next(reversed(self._totals), None)
        if phase is None or phase not in self._first:
            return ""
        begun_s, n_first = self._first[phase]
        n_done, n_left = self._done[phase] - n_first, self._totals[phase] - self._done[phase]
        passed_s = self._now_s() - begun_s
        if n_done < _FEW or not n_left or passed_s <= 0:
            return ""
        left_s = n_left * passed_s / n_done
        left = length_text(left_s)
        return f", about {left} left of this round: more may follow" if self._in_rounds else f", about {left} left"


class RunTime:
    """Progress through the run time of a twin: a bar with the time left in a terminal, nothing elsewhere."""

    def __init__(self, console: Console, total_s: float) -> None:
        self.now_s = 0.0
        words = TextColumn("{task.completed:.0f} of {task.total:.0f} s of run time")
        columns = (words, BarColumn(), TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn())
        self._bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
        self._task = self._bar.add_task("", total=total_s)

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def reached(self, now_ns: int) -> None:
        """Show that the twin is at a run time, in ns."""
        self.now_s = now_ns / NS_PER_S
        self._bar.update(self._task, completed=self.now_s)
