"""Progress display of `tis compare`: bars in a terminal, a line every few seconds elsewhere."""

import time
from collections.abc import Callable
from types import TracebackType
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

_LINE_EVERY_S: Final = 10.0
_TRAININGS: Final = "models identified"
_CELLS: Final = "twins"


class CompareProgress:
    """A `deploy.compare.pool.Watcher` that shows both phases: identification, then twins."""

    def __init__(self, console: Console, n_cells: int, now_s: Callable[[], float] = time.monotonic) -> None:
        self._console = console
        self._now_s = now_s
        self._begun_s = now_s()
        self._next_line_s = _LINE_EVERY_S
        self._n_trainings = self._n_trained = self._n_settled = 0
        self._n_cells = n_cells
        self._bars: Progress | None = None
        self._training_bar: TaskID | None = None
        self._cell_bar: TaskID | None = None

    def __enter__(self) -> Self:
        if self._console.is_terminal:
            columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
            times = (TimeElapsedColumn(), TimeRemainingColumn())
            self._bars = Progress(*columns, *times, console=self._console, transient=True)
            self._bars.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bars is not None:
            self._bars.stop()

    def begin(self, n_trainings: int) -> None:
        """Show the number of trainings."""
        self._n_trainings = n_trainings
        self._draw()

    def trained(self) -> None:
        """Count a training."""
        self._n_trained += 1
        self._draw()

    def settled(self, n_cells: int) -> None:
        """Count cells."""
        self._n_settled += n_cells
        self._draw()

    def wait(self) -> None:
        """Print a line when it is due, unless there are bars."""
        passed_s = self._now_s() - self._begun_s
        if self._bars is None and passed_s >= self._next_line_s:
            self._next_line_s = passed_s + _LINE_EVERY_S
            self._console.print(f"{passed_s:4.0f} s  {self._line()}", highlight=False, soft_wrap=True)

    def _line(self) -> str:
        trainings = f"{_TRAININGS} {self._n_trained}/{self._n_trainings}, " if self._n_trainings else ""
        return f"{trainings}{_CELLS} {self._n_settled}/{self._n_cells}"

    def _draw(self) -> None:
        if self._bars is None:
            return
        if self._training_bar is None and self._n_trainings:
            self._training_bar = self._bars.add_task(_TRAININGS, total=self._n_trainings)
        if self._cell_bar is None:
            self._cell_bar = self._bars.add_task(_CELLS, total=self._n_cells)
        if self._training_bar is not None:
            self._bars.update(self._training_bar, completed=self._n_trained)
        self._bars.update(self._cell_bar, completed=self._n_settled)
