"""The window of a timeline entry on the grid of run time, and its strength in each cell."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final, Self

from tis.common.scenario.network.conditions import Change, TimelineEntry
from tis.common.scenario.network.pipeline import Stages
from tis.common.units import ms_to_ns, s_to_ns
from tis.netem.draws.grid import LAST_CELL, nearest_cell

STAGES: Final = (*Stages.model_fields, "ordering")
"""The fields of a pipeline that a change may replace."""


@dataclass(frozen=True)
class Window:
    """The cells in which an entry holds, ``begin`` .. ``end - 1``, with ramps of ``ramp`` cells at both ends.

    ``cut`` is the cell at which it was cleared, if it was; its ramps do not move. Without an end there is no ramp
    down.
    """

    entry: TimelineEntry = field(repr=False)
    begin: int
    end: int
    ramp: int
    cut: int = LAST_CELL

    @classmethod
    def of(cls, entry: TimelineEntry, earliest: int = 0) -> Self:
        """Return an entry's window: its edges move to the nearest cells, at least one cell apart.

        A window that would begin before ``earliest`` begins there and keeps its length.
        """
        at_ns = s_to_ns(entry.at_s)
        begin, end = nearest_cell(at_ns), LAST_CELL
        ramp = nearest_cell(s_to_ns(entry.ramp_s))
        if entry.for_s is not None:
            end = max(begin + 1, nearest_cell(at_ns + s_to_ns(entry.for_s)))
            ramp = min(ramp, (end - begin) // 2)
        late = max(0, earliest - begin)
        return cls(entry, begin + late, min(end + late, LAST_CELL), ramp)

    @property
    def stop(self) -> int:
        """Return the first cell after the window."""
        return min(self.end, self.cut)

    @property
    def change(self) -> Change:
        """Return the change that holds."""
        return self.entry.set

    @cached_property
    def stages(self) -> dict[str, Any]:
        """Return the stages that the change replaces."""
        return {name: stage for name in STAGES if (stage := getattr(self.change, name)) is not None}

    @cached_property
    def add_delay_ns(self) -> int:
        """Return the addition to delays at full strength."""
        return ms_to_ns(self.change.add_delay_ms)

    @cached_property
    def modulates(self) -> bool:
        """Tell whether the change has a field that ramps."""
        change = self.change
        scales = change.scale_delay != 1.0 or change.scale_rate != 1.0
        return scales or change.add_delay_ms > 0 or change.add_p_loss > 0

    @property
    def edges(self) -> list[int]:
        """Return the cells at which a step lies, or a ramp begins or ends."""
        edges = [self.begin, self.stop]
        if self.ramp and self.modulates:
            # cell end - ramp still has full strength; the next one is the first with less
            edges += [edge for edge in (self.begin + self.ramp, self.end - self.ramp + 1) if edge < self.stop]
        return edges

    def moves_in(self, cell: int) -> bool:
        """Tell whether the strength changes from ``cell`` to the next one."""
        return self.ramp > 0 and self.modulates and not self.begin + self.ramp <= cell <= self.end - self.ramp

    def strength(self, cell: int) -> float:
        """Return the strength in ``cell``, at its beginning: 0 none, 1 full."""
        if self.ramp == 0:
            return 1.0
        return min(1.0, (cell - self.begin) / self.ramp, (self.end - cell) / self.ramp)
