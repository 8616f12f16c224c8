"""The timeline: changes that hold for a stretch of run time, in steps or ramps, and those added while running."""

from bisect import bisect_right
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np

from common.channels import Direction
from common.errors import Fault, InputError
from common.scenario.network.conditions import TimelineEntry
from common.units import NS_PER_S
from netem.conditions.standing import give_way
from netem.conditions.window import Window
from netem.draws.grid import CELL_NS, LAST_CELL

MOST_ADDED: Final = 1000


class Segment(NamedTuple):
    """Cells ``begin`` .. ``end - 1``, in which the same windows hold.

    ``stages`` are those that they replace, the last word on each, and ``clean`` if those not given are absent;
    ``modulating`` are the windows that stretch delays or add losses, in order; ``moves``: one of these is ramped
    meanwhile.
    """

    begin: int
    end: int
    is_empty: bool
    outage: bool
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
        """Tell whether nothing ever holds."""
        return not self._written and not self._added

    def at(self, cell: int) -> Segment:
        """Return the segment that ``cell`` lies in (oracle: each entry by itself, cell by cell, test_timeline)."""
        if self._stale:
            self._index()
        held = self._held
        if not held.begin <= cell < held.end:
            held = self._held = self._find(cell)
        return held

    def add(self, entry: TimelineEntry, earliest: int) -> int:
        """Append an entry that begins in cell ``earliest`` or later; return the cell in which it begins.

        What held in earlier cells stays. At most 1000 added entries are remembered: beyond that, those that are over
        are forgotten, and if none is, the entry is refused with `InputError`.
        """
        window = Window.of(entry, earliest)
        if self._concerns(entry):
            if len(self._added) >= MOST_ADDED:
                self._added = [one for one in self._added if one.stop > earliest]
            if len(self._added) >= MOST_ADDED:
                rule = f"must come while fewer than {MOST_ADDED} added changes hold; clear them first"
                raise InputError(Fault("control", "", rule))
            self._added.append(window)
            self._stale = True
        return window.begin

    def give_way(self, entry: TimelineEntry, earliest: int) -> None:
        """Forget the added entries that are over; those that have no end lose what ``entry`` gives if it has none."""
        if self._concerns(entry):
            left = self._added
            if entry.for_s is None:
                left = give_way(left, entry.set, Window.of(entry, earliest).begin)
            self._added = [one for one in left if one.stop >= earliest]
            self._stale = True

    def clear_added(self, cell: int) -> None:
        """End every added entry where ``cell`` begins; what held in earlier cells stays."""
        self._added = [replace(one, cut=min(one.cut, cell)) for one in self._added if one.begin < cell]
        self._stale = True

    def added(self, cell: int) -> tuple[TimelineEntry, ...]:
        """Return the added entries that hold in ``cell`` or will, each from when it really holds."""
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
        # arrays over the windows: of a timeline of thousands of steps without an end, thousands hold
        self._begins = np.array([window.begin for window in windows], np.int64)
        self._stops = np.array([window.stop for window in windows], np.int64)
        self._silences = np.array([window.change.outage for window in windows], np.bool_)
        self._modulates = np.array([window.modulates for window in windows], np.bool_)
        self._cleans = np.array([window.change.clean for window in windows], np.bool_)
        given = {name for window in windows for name in window.stages}
        self._gives = {name: np.array([name in window.stages for window in windows]) for name in sorted(given)}
        self._held = self._find(0)

    def _find(self, cell: int) -> Segment:
        i = min(bisect_right(self._edges, cell), len(self._edges) - 1)
        holding = (self._begins <= cell) & (cell < self._stops)
        modulating = tuple(self._windows[j] for j in np.flatnonzero(holding & self._modulates).tolist())
        stages: dict[str, Any] = {}
        cleaners = np.flatnonzero(holding & self._cleans)
        if len(cleaners):
            stages["clean"] = True
            holding_still = holding & (np.arange(len(holding)) >= cleaners[-1])
        else:
            holding_still = holding
        for name, gives in self._gives.items():
            givers = np.flatnonzero(holding_still & gives)
            if len(givers):
                stages[name] = self._windows[givers[-1]].stages[name]
        return Segment(
            begin=self._edges[i - 1],
            end=self._edges[i],
            is_empty=not holding.any(),
            outage=bool((holding & self._silences).any()),
            stages=stages,
            modulating=modulating,
            moves=any(window.moves_in(cell) for window in modulating),
        )
