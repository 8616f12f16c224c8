"""The conditions of one direction by run time: outages, steps, joint states, the timeline, changes during the run.

The state's change comes first, then the timeline's entries in order, then the added ones. Stage by stage the last one
wins; factors multiply, additions add, additional losses are independent. Conditions apply to packets when they are
offered; packets in flight are not affected, except that a rate and a stall hold for all that waits
(`tis.netem.link.queue.queues`).
"""

from collections.abc import Iterable, Sequence
from typing import Any, Final, NamedTuple, Self

from tis.common.channels import Direction
from tis.common.scenario.network import NetworkPart
from tis.common.scenario.network.conditions import Change, TimelineEntry
from tis.common.scenario.network.pipeline import Pipeline
from tis.common.units import ms_to_ns
from tis.netem.conditions.outage import Outage, outages_of
from tis.netem.conditions.states import NO_STATE, StatePath
from tis.netem.conditions.steps import StepPath, steps_of
from tis.netem.conditions.timeline import STAGES, Segment, Timeline
from tis.netem.draws.grid import CELL_NS, LAST_CELL, cell_of

FOREVER_NS: Final = LAST_CELL * CELL_NS
_MAX_KEPT: Final = 256


class Condition(NamedTuple):
    """The condition from ``since_ns`` until ``until_ns``, exclusive; the next change is there or later.

    ``changes`` has at most one change, with all replaced stages; equal ones are the same object, so that `is`
    compares them. A delay becomes ``round(delay * scale_delay) + add_delay_ns``. In a stall nothing is sent.
    """

    until_ns: int = FOREVER_NS
    outage: bool = False
    changes: tuple[Change, ...] = ()
    scale_delay: float = 1.0
    add_delay_ns: int = 0
    p_extra_loss: float = 0.0
    state: str | None = None
    since_ns: int = -FOREVER_NS
    stall: bool = False
    scale_rate: float = 1.0

    @property
    def is_clear(self) -> bool:
        """Tell whether the pipelines apply as they are."""
        modulates = self.scale_delay != 1.0 or self.add_delay_ns or self.p_extra_loss
        return not (self.outage or self.stall or self.changes or modulates)


_STALE: Final = Condition(until_ns=-FOREVER_NS, since_ns=FOREVER_NS)


class Span(NamedTuple):
    """A stretch of run time for a report; ``changed``: an entry of the timeline, or an added one, holds."""

    begin_ns: int
    end_ns: int
    state: str | None
    outage: bool
    changed: bool
    stall: bool = False


class _Found(NamedTuple):
    """The parts of a condition, before ramps."""

    begin: int
    end: int
    state: int
    outage: bool
    stall: bool
    segment: Segment
    step_ns: int


class Conditions:
    """The conditions of one direction by run time; they do not depend on the order of access."""

    def __init__(
        self,
        outages: Sequence[Outage],
        states: StatePath | None,
        state_changes: Sequence[Change],
        timeline: Timeline,
        steps: Sequence[StepPath] = (),
    ) -> None:
        self._outages: Final = tuple(outages)
        self._states: Final = states
        self._state_changes: Final = tuple(state_changes)
        self._state_stages: Final = [_stages_given([change]) for change in state_changes]
        self._timeline: Final = timeline
        self._steps: Final = tuple(steps)
        self._tuples: dict[Change, tuple[Change, ...]] = {}
        self._replaced: tuple[int, Segment | None, tuple[Change, ...]] = (NO_STATE, None, ())
        self._held = self._condition(0)

    @classmethod
    def of(cls, network: NetworkPart, direction: Direction, seed: int) -> Self:
        """Return the conditions of one direction of a scenario's network."""
        states = network.states
        return cls(
            outages_of(network.outages, direction, seed),
            None if states is None else StatePath.of(states, seed),
            () if states is None else [getattr(state, direction) for state in states.states],
            Timeline(network.timeline, direction),
            steps_of(network.steps, direction, seed),
        )

    @property
    def is_constant(self) -> bool:
        """Tell whether there is only one condition."""
        stays = self._states is None or self._states.at(0).end == LAST_CELL
        return stays and not self._outages and not self._steps and self._timeline.is_empty

    def at(self, now_ns: int) -> Condition:
        """Return the condition at ``now_ns``; before the run it is the one of the first ms.

        After `add` and `clear_added` an earlier result is out of date: its ``until_ns`` may be too late. Oracle:
        every part by itself, cell by cell, tests/netem/conditions/test_conditions.
        """
        held = self._held
        if not held.since_ns <= now_ns < held.until_ns:
            held = self._held = self._condition(cell_of(now_ns))
        return held

    def prepare(self, now_ns: int) -> None:
        """Make the next draws ahead of their use; call it in an idle moment. Cheap when they exist already."""
        cell = cell_of(now_ns)
        for process in self._outages:
            process.path.prepare(cell)
        if self._states is not None:
            self._states.prepare(cell)

    def add(self, entry: TimelineEntry, now_ns: int) -> int:
        """Append an entry to the timeline; return the ns from which it holds, the next cell's edge at the earliest.

        ``at_s`` is run time; an entry whose ``at_s`` has passed begins at the next edge and keeps its length. An
        entry of the other direction is ignored. Raises `InputError` when too many were added.
        """
        begin = self._timeline.add(entry, cell_of(now_ns) + 1)
        self._held = _STALE
        return begin * CELL_NS

    def supersede(self, entry: TimelineEntry, now_ns: int) -> None:
        """End the fields that ``entry`` gives in earlier added entries, from its beginning.

        This applies if neither ``entry`` nor the earlier one has an end. Added entries that have ended are removed.
        """
        self._timeline.supersede(entry, cell_of(now_ns) + 1)
        self._held = _STALE

    def clear_added(self, now_ns: int) -> int:
        """End all added entries, ramps too, at the next cell's edge; return that instant."""
        cell = cell_of(now_ns) + 1
        self._timeline.clear_added(cell)
        self._held = _STALE
        return cell * CELL_NS

    def added(self, now_ns: int) -> tuple[TimelineEntry, ...]:
        """Return the added entries that hold at ``now_ns`` or later, in order, each with its actual beginning."""
        return self._timeline.added(cell_of(now_ns))

    def spans(self, until_ns: int) -> list[Span]:
        """Return the spans from 0 until ``until_ns``, without gaps; a ramp is one span."""
        spans: list[Span] = []
        cell = 0
        while cell * CELL_NS < until_ns:
            found = self._find(cell)
            cell = found.end
            begin_ns, end_ns = found.begin * CELL_NS, min(cell * CELL_NS, until_ns)
            state, changed = self._state_name(found.state), not found.segment.is_empty
            spans.append(Span(begin_ns, end_ns, state, found.outage, changed, found.stall))
        return joined(spans)

    def _find(self, cell: int) -> _Found:
        segment = self._timeline.at(cell)
        begin, end = segment.begin, segment.end
        state, outage, stall = NO_STATE, segment.outage, segment.stall
        if self._states is not None:
            stay = self._states.at(cell)
            begin, end, state = max(begin, stay.begin), min(end, stay.end), stay.value
            if state != NO_STATE:
                outage = outage or self._state_changes[state].outage
                stall = stall or self._state_changes[state].stall
        for process in self._outages:
            stretch = process.path.at(cell)
            begin, end = max(begin, stretch.begin), min(end, stretch.end)
            if stretch.value == 1:
                outage, stall = outage or not process.stalls, stall or process.stalls
        step_ns = 0
        for steps in self._steps:
            stretch = steps.at(cell)
            begin, end, step_ns = max(begin, stretch.begin), min(end, stretch.end), step_ns + stretch.value
        return _Found(begin, end, state, outage, stall, segment, step_ns)

    def _condition(self, cell: int) -> Condition:
        begin, end, state, outage, stall, segment, step_ns = self._find(cell)
        if segment.moves:  # in a ramp every cell is a condition of its own
            begin, end = cell, cell + 1
        scale, scale_rate, add_ns, p_loss = 1.0, 1.0, step_ns, 0.0
        if state != NO_STATE:
            change = self._state_changes[state]
            scale_rate = change.scale_rate
            scale, p_loss = change.scale_delay, change.add_p_loss
            add_ns += ms_to_ns(change.add_delay_ms)
        for window in segment.modulating:
            change, strength = window.change, window.strength(cell)
            scale *= 1.0 - strength + strength * change.scale_delay
            scale_rate *= 1.0 - strength + strength * change.scale_rate
            add_ns += round(strength * window.add_delay_ns)
            p_loss += (1.0 - p_loss) * strength * change.add_p_loss
        return Condition(
            until_ns=end * CELL_NS,
            outage=outage,
            stall=stall,
            changes=self._changes(state, segment),
            scale_rate=scale_rate,
            scale_delay=scale,
            add_delay_ns=add_ns,
            p_extra_loss=p_loss,
            state=self._state_name(state),
            since_ns=begin * CELL_NS if begin else -FOREVER_NS,
        )

    def _state_name(self, state: int) -> str | None:
        return None if state == NO_STATE or self._states is None else self._states.names[state]

    def _changes(self, state: int, segment: Segment) -> tuple[Change, ...]:
        """Return the replaced stages as one change; equal ones are the same object."""
        for_state, for_segment, changes = self._replaced
        if state != for_state or segment is not for_segment:
            hides_state = state == NO_STATE or "clean" in segment.stages
            stages = {**({} if hides_state else self._state_stages[state]), **segment.stages}
            changes = self._in_one(stages)
            self._replaced = (state, segment, changes)
        return changes

    def _in_one(self, stages: dict[str, Any]) -> tuple[Change, ...]:
        if not stages:
            return ()
        change = Change.model_construct(**stages)
        if len(self._tuples) >= _MAX_KEPT:  # there is no bound on changes that are added during the run
            self._tuples.clear()
        return self._tuples.setdefault(change, (change,))


def joined(spans: Iterable[Span]) -> list[Span]:
    """Return spans of which neighbours that are alike are one."""
    found: list[Span] = []
    for span in spans:
        if found and found[-1][2:] == span[2:]:
            found[-1] = found[-1]._replace(end_ns=span.end_ns)
        else:
            found.append(span)
    return found


def merged(pipeline: Pipeline, changes: Sequence[Change]) -> Pipeline:
    """Return a pipeline with the stages that ``changes`` replace; the last change wins.

    The result must be valid by itself (`Pipeline`), so stages that lack what they need are dropped: jitter,
    correlation and reorder without a delay, correlation beside a trace, reorder with another ordering, and what a
    recovery of lost messages excludes.
    """
    given = _stages_given(changes)
    if not given:
        return pipeline
    kept = Pipeline() if given.pop("clean", False) else pipeline
    result = kept.model_copy(update=given)
    dropped: dict[str, Any] = {}
    if result.delay is None:
        dropped = dict.fromkeys(("jitter", "correlation", "reorder"))
    elif result.delay.kind == "trace":
        dropped = {"correlation": None}
    if result.ordering != "reorder":
        dropped["reorder"] = None
    if result.recovery is not None:
        dropped |= {**dict.fromkeys(("duplicate", "corrupt", "rate", "reorder")), "ordering": "fifo"}
    return result.model_copy(update=dropped)


def _stages_given(changes: Sequence[Change]) -> dict[str, Any]:
    """Return the stages that replace those of a pipeline, and ``clean`` when all others are absent."""
    given: dict[str, Any] = {}
    for change in reversed(changes):
        for name in STAGES:
            stage = getattr(change, name)
            if stage is not None and name not in given:
                given[name] = stage
        if change.clean:
            given["clean"] = True
            break
    return given
