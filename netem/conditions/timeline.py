"""The timeline of one direction: scheduled changes, in steps or ramps, and changes added during the run.

Each entry is a window on the grid of run time, with a strength in each cell.
"""

from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Final, NamedTuple, Self

import numpy as np

from tis.common.channels import Direction
from tis.common.errors import Fault, InputError
from tis.common.scenario.network.conditions import Change, TimelineEntry
from tis.common.scenario.network.pipeline import Stages
from tis.common.units import NS_PER_S, ms_to_ns, s_to_ns
from tis.netem.draws.grid import CELL_NS, LAST_CELL, nearest_cell

STAGES: Final = (*Stages.model_fields, "ordering")
"""The fields of a pipeline that a change may replace."""

MAX_ADDED: Final = 1000
_MODULATIONS: Final = frozenset({"outage", "stall", "scale_rate", "scale_delay", "add_delay_ms", "add_p_loss"})
"""The fields of a change that act on top of a pipeline, whatever its stages are."""


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


class Segment(NamedTuple):
    """Cells ``begin`` .. ``end - 1``, in which the same windows hold.

    ``stages`` are the replaced stages, each by the last window that gives it, and ``clean`` if all others are absent;
    ``modulating`` are the windows that scale rates and delays or add losses, in order; ``moves``: one of them is in a
    ramp.
    """

    begin: int
    end: int
    is_empty: bool
    outage: bool
    stall: bool
    stages: Mapping[str, Any]
    modulating: tuple[Window, ...]
    moves: bool


class Timeline:
    """The windows of one direction, in the order of precedence: the later wins."""

    def __init__(self, entries: Iterable[TimelineEntry], direction: Direction) -> None:
        self._direction: Final = direction
        self._written = [Window.of(entry) for entry in entries if self._concerns(entry)]
        self._added: list[Window] = []
        self._held: Segment
        self._index()

    @property
    def is_empty(self) -> bool:
        """Tell whether there is no window at all."""
        return not self._written and not self._added

    def at(self, cell: int) -> Segment:
        """Return the segment that contains ``cell`` (oracle: each entry by itself, cell by cell, test_timeline)."""
        if self._stale:
            self._index()
        held = self._held
        if not held.begin <= cell < held.end:
            held = self._held = self._find(cell)
        return held

    def add(self, entry: TimelineEntry, earliest: int) -> int:
        """Append an entry that begins in cell ``earliest`` or later; return the cell in which it begins.

        Earlier cells do not change. At most 1000 added entries are kept: beyond that, those that have ended are
        removed; raises `InputError` if none has.
        """
        window = Window.of(entry, earliest)
        if self._concerns(entry):
            if len(self._added) >= MAX_ADDED:
                self._added = [one for one in self._added if one.stop > earliest]
            if len(self._added) >= MAX_ADDED:
                rule = f"must come while fewer than {MAX_ADDED} added changes hold; clear them first"
                raise InputError(Fault("control", "", rule))
            self._added.append(window)
            self._stale = True
        return window.begin

    def supersede(self, entry: TimelineEntry, earliest: int) -> None:
        """Remove added entries that have ended; an ``entry`` without an end replaces its fields in the others."""
        if self._concerns(entry):
            left = self._added
            if entry.for_s is None:
                left = _superseded(left, entry.set, Window.of(entry, earliest).begin)
            self._added = [one for one in left if one.stop >= earliest]
            self._stale = True

    def clear_added(self, cell: int) -> None:
        """End every added entry where ``cell`` begins; earlier cells do not change."""
        self._added = [replace(one, cut=min(one.cut, cell)) for one in self._added if one.begin < cell]
        self._stale = True

    def added(self, cell: int) -> tuple[TimelineEntry, ...]:
        """Return the added entries that hold in ``cell`` or later, each with its actual beginning."""
        return tuple(
            one.entry.model_copy(update={"at_s": one.begin * CELL_NS / NS_PER_S})
            for one in self._added
            if one.stop > cell
        )

    def _concerns(self, entry: TimelineEntry) -> bool:
        return entry.direction in (self._direction, "both")

    def _index(self) -> None:
        self._stale = False
        windows = self._windows = [*self._written, *self._added]
        self._edges = sorted({0, LAST_CELL, *(edge for window in windows for edge in window.edges)})
        # arrays over the windows: in a timeline of thousands of steps without an end, thousands hold at a time
        self._begins = np.array([window.begin for window in windows], np.int64)
        self._stops = np.array([window.stop for window in windows], np.int64)
        self._outages = np.array([window.change.outage for window in windows], np.bool_)
        self._stalls = np.array([window.change.stall for window in windows], np.bool_)
        self._modulates = np.array([window.modulates for window in windows], np.bool_)
        self._cleans = np.array([window.change.clean for window in windows], np.bool_)
        given = {name for window in windows for name in window.stages}
        self._gives = {name: np.array([name in window.stages for window in windows]) for name in sorted(given)}
        self._held = self._find(0)

    def _find(self, cell: int) -> Segment:
        i = min(bisect_right(self._edges, cell), len(self._edges) - 1)
        holding = (self._begins <= cell) & (cell < self._stops)
        modulating = tuple(self._windows[j] for j in np.flatnonzero(holding & self._modulates).tolist())
        # a window with ``clean`` removes the stages of all windows before it; of the others the last one wins
        stages: dict[str, Any] = {}
        cleaners = np.flatnonzero(holding & self._cleans)
        effective = holding
        if len(cleaners):
            stages["clean"] = True
            effective = holding & (np.arange(len(holding)) >= cleaners[-1])
        for name, gives in self._gives.items():
            givers = np.flatnonzero(effective & gives)
            if len(givers):
                stages[name] = self._windows[givers[-1]].stages[name]
        return Segment(
            begin=self._edges[i - 1],
            end=self._edges[i],
            is_empty=not holding.any(),
            outage=bool((holding & self._outages).any()),
            stall=bool((holding & self._stalls).any()),
            stages=stages,
            modulating=modulating,
            moves=any(window.moves_in(cell) for window in modulating),
        )


def _superseded(added: Sequence[Window], later: Change, begin: int) -> list[Window]:
    """Return the windows, with those without an end ended at cell ``begin`` in the fields that ``later`` gives.

    So repeated changes without an end leave at most one window for each field, and a factor that is set again does
    not multiply. Ramps that have begun continue. Oracle: merged mappings, tests/netem/control/test_control.
    """
    left: list[Window] = []
    for window in added:
        if window.entry.for_s is not None or window.stop < LAST_CELL:
            left.append(window)
            continue
        kept, replaced = _split(window.change, later)
        if kept is not None:
            left.append(_with(window, kept))
        if replaced is not None and window.begin < begin:
            left.append(replace(_with(window, replaced), cut=begin))
    return left


def _with(window: Window, change: Change) -> Window:
    return replace(window, entry=window.entry.model_copy(update={"set": change}))


def _split(change: Change, later: Change) -> tuple[Change | None, Change | None]:
    """Return the fields of a change that a later one keeps, and those that it replaces; None for no field."""
    given = change.model_fields_set
    gone = given & later.model_fields_set
    if later.clean:
        gone |= given - _MODULATIONS

    def part(names: AbstractSet[str]) -> Change | None:
        return Change.model_construct(**{name: getattr(change, name) for name in names}) if names else None

    return part(given - gone), part(gone)
