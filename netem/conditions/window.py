"""Where an entry of the timeline holds, on the grid, and how strongly."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final, Self

from common.scenario.network.conditions import Change, TimelineEntry
from common.scenario.network.pipeline import Stages
from common.units import ms_to_ns, s_to_ns
from netem.draws.grid import LAST_CELL, nearest_cell

STAGES: Final = (*Stages.model_fields, "ordering")
"""What a change may replace of a pipeline."""


@dataclass(frozen=True)
class Window:
    """Where an entry holds: cells ``begin`` .. ``end - 1``, ramped for ``ramp`` cells at both ends.

    ``cut`` is where it was cleared, if it was; its ramps stay where they are. The end is no ramp when there is none.
    """

    entry: TimelineEntry = field(repr=False)
    begin: int
    end: int
    ramp: int
    cut: int = LAST_CELL

    @classmethod
    def of(cls, entry: TimelineEntry, earliest: int = 0) -> Self:
        """Return an entry's window: its edges go to the nearest cells, at least one cell apart.

        One that would begin before ``earliest`` begins there and holds as long as it was to hold.
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
        """Return the first cell in which it no longer holds."""
        return min(self.end, self.cut)

    @property
    def change(self) -> Change:
        """Return what holds."""
        return self.entry.set

    @cached_property
    def stages(self) -> dict[str, Any]:
        """Return the stages that it replaces."""
        return {name: stage for name in STAGES if (stage := getattr(self.change, name)) is not None}

    @cached_property
    def add_delay_ns(self) -> int:
        """Return what it adds to a delay once it is fully there."""
        return ms_to_ns(self.change.add_delay_ms)

    @cached_property
    def modulates(self) -> bool:
        """Tell whether it has something that a ramp would ramp."""
        change = self.change
        return change.scale_delay != 1.0 or change.add_delay_ms > 0 or change.add_p_loss > 0

    @property
    def edges(self) -> list[int]:
        """Return the cells at which it steps, or a ramp begins or ends."""
        edges = [self.begin, self.stop]
        if self.ramp and self.modulates:
            # at end - ramp it is still fully there; the first cell with less is the next one
            edges += [edge for edge in (self.begin + self.ramp, self.end - self.ramp + 1) if edge < self.stop]
        return edges

    def moves_in(self, cell: int) -> bool:
        """Tell whether the next cell sees another strength of what is ramped."""
        return self.ramp > 0 and self.modulates and not self.begin + self.ramp <= cell <= self.end - self.ramp

    def strength(self, cell: int) -> float:
        """Return how much of what is ramped holds in ``cell``, by its beginning: 0 not at all, 1 fully."""
        if self.ramp == 0:
            return 1.0
        return min(1.0, (cell - self.begin) / self.ramp, (self.end - cell) / self.ramp)
