"""Live control: a request changes both links at one instant, or is refused with reasons; the state is reported.

`Control.read` is the costly part and needs no lock: it validates, and draws once from every changed pipeline.
`Control.apply` and `snapshot` run between two packets.
"""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from tis.common.channels import Direction
from tis.common.errors import Fault
from tis.common.node import Record
from tis.common.records import CONTROL, ControlNote
from tis.common.scenario.control import (
    CLEARING,
    Acknowledgement,
    DirectionState,
    EmulatorState,
    Held,
    RecentDelays,
    RuleState,
)
from tis.common.scenario.network.conditions import TimelineEntry
from tis.common.scenario.reading import Profiles
from tis.common.units import NS_PER_MS, NS_PER_S, s_to_ns
from tis.netem.conditions.conditions import FOREVER_NS, Condition, merged
from tis.netem.conditions.timeline import MAX_ADDED
from tis.netem.control.replay import apply_entries, entries_json
from tis.netem.control.request import Adapt, Reader, Request, directions_of
from tis.netem.draws.grid import CELL_NS, cell_of, nearest_cell
from tis.netem.link.link import Link
from tis.netem.link.rules import RuleTable

_MAX_OPERATION: Final = 40
_MAX_REASON: Final = 1000
_WHERE: Final = "control"
_NOTHING: Final = EmulatorState(running=False)


class Control:
    """Requests to two running links, and counts of accepted and refused ones."""

    def __init__(
        self, links: Mapping[Direction, Link], library: Profiles | None = None, adapt: Adapt | None = None
    ) -> None:
        self.links: Final = links
        self.n_accepted = 0
        self.n_refused = 0
        self._reader = Reader(links, library, adapt)

    def handle(self, operation: str, payload: bytes, now_ns: int | None) -> tuple[Acknowledgement, list[Record]]:
        """Read a request and apply it at ``now_ns``; no payload raises."""
        return self.apply(self.read(operation, payload), now_ns)

    def read(self, operation: str, payload: bytes | None, n_bytes: int = 0) -> Request:
        """Return a parsed request, or the reasons of its refusal; ``payload`` is None if it is too large to read."""
        if payload is None:
            return self._reader.unread(operation, n_bytes)
        return self._reader.read(operation, payload)

    def apply(self, request: Request, now_ns: int | None) -> tuple[Acknowledgement, list[Record]]:
        """Apply all changes of a request, in both links from the same cells, or none; return answer and log records.

        ``now_ns`` is None before and after the run, when nothing can be changed. Packets in flight are not affected,
        unless they wait for a rate.
        """
        reasons = request.reasons or self._reasons_now(request, now_ns)
        if reasons or now_ns is None:
            self.n_refused += 1
            refused = Acknowledgement(
                id=request.id, operation=request.operation, accepted=False, at_ns=now_ns, reasons=reasons
            )
            return refused, self._note(request, refused, ())
        entries = self._entries(request, now_ns)
        cleared = request.operation in CLEARING
        from_ns = apply_entries(self.links, entries, cleared, now_ns)
        self.n_accepted += 1
        accepted = Acknowledgement(
            id=request.id, operation=request.operation, accepted=True, at_ns=now_ns, from_ns=from_ns,
            held=_held(entries),
        )  # fmt: skip
        return accepted, self._note(request, accepted, entries)

    def counters(self) -> dict[str, int]:
        """Return the counts, by name."""
        return {"control.accepted": self.n_accepted, "control.refused": self.n_refused}

    def _reasons_now(self, request: Request, now_ns: int | None) -> tuple[str, ...]:
        if now_ns is None:
            return (str(Fault(_WHERE, "", "must come while messages pass: not before the run begins, nor after it")),)
        found: list[str] = []
        for one in request.sets:
            if one.at_s is not None and nearest_cell(s_to_ns(one.at_s)) <= cell_of(now_ns):
                rule = f"must lie ahead: run time is {now_ns / NS_PER_S:.3f} s"
                found.append(str(Fault(_WHERE, "at_s", rule, one.at_s)))
        for direction, link in self.links.items():
            concerned = [one for one in request.sets if direction in directions_of(one.direction)]
            n_added = 0 if request.operation in CLEARING else len(link.conditions.added(now_ns))
            # an entry without an end splits at most one other entry for each field that it sets
            n_more = sum(1 + (len(one.change.model_fields_set) if one.for_s is None else 0) for one in concerned)
            if n_more and n_added + n_more > MAX_ADDED:
                rule = f"has {n_added} requested changes that hold now or later: reset it first"
                found.append(str(Fault(_WHERE, direction, rule)))
        return tuple(found)

    @staticmethod
    def _entries(request: Request, now_ns: int) -> tuple[TimelineEntry, ...]:
        begin_s = (cell_of(now_ns) + 1) * CELL_NS / NS_PER_S
        return tuple(one.entry(begin_s) for one in request.sets)

    @staticmethod
    def _note(request: Request, answer: Acknowledgement, entries: Sequence[TimelineEntry]) -> list[Record]:
        at_ns = answer.at_ns or 0
        note = ControlNote(
            at_ns=at_ns,
            applied_ns=answer.from_ns or 0,
            operation=request.operation[:_MAX_OPERATION],
            request=request.text,
            added=entries_json(entries),
            accepted=answer.accepted,
            reason="; ".join(answer.reasons)[:_MAX_REASON],
        )
        return [Record(CONTROL, at_ns, note)]


def _held(entries: Sequence[TimelineEntry]) -> tuple[Held, ...]:
    held = []
    for entry in entries:
        begin = nearest_cell(s_to_ns(entry.at_s))
        end_ns = None
        if entry.for_s is not None:
            end_ns = max(begin + 1, nearest_cell(s_to_ns(entry.at_s) + s_to_ns(entry.for_s))) * CELL_NS
        held += [
            Held(direction=direction, from_ns=begin * CELL_NS, until_ns=end_ns)
            for direction in directions_of(entry.direction)
        ]
    return tuple(held)


class Snapshot(NamedTuple):
    """The state of a link between two packets."""

    rules: RuleTable
    condition: Condition
    added: tuple[TimelineEntry, ...]
    counters: dict[str, int]


def snapshot(links: Mapping[Direction, Link], now_ns: int) -> dict[Direction, Snapshot]:
    """Copy what `describe` needs from both links; it is quick, since packets wait meanwhile."""
    return {
        direction: Snapshot(link.rules, link.conditions.at(now_ns), link.conditions.added(now_ns), link.counters())
        for direction, link in links.items()
    }


def describe(
    links: Mapping[Direction, Snapshot] | None, now_ns: int | None, counters: Mapping[str, int] | None = None,
    delays: Mapping[Direction, RecentDelays | None] | None = None,
) -> EmulatorState:  # fmt: skip
    """Return the reported state, or the one of an idle emulator without a run (oracle: literals, test_state).

    ``delays`` are given by an emulator that runs by itself.
    """
    if links is None or now_ns is None:
        return _NOTHING
    return EmulatorState(
        running=True,
        standalone=delays is not None,
        at_s=now_ns / NS_PER_S,
        unmatched=links["forward"].rules.unmatched,
        forward=_direction("forward", links["forward"], delays or {}),
        feedback=_direction("feedback", links["feedback"], delays or {}),
        counters=dict(counters or {}),
    )


def _direction(
    direction: Direction, link: Snapshot, delays: Mapping[Direction, RecentDelays | None]
) -> DirectionState:
    condition = link.condition
    rules = tuple(
        RuleState(key=str(key), pipeline=pipeline, now=merged(pipeline, condition.changes))
        for key, pipeline in link.rules.rules
    )
    return DirectionState(
        state=condition.state,
        outage=condition.outage,
        stall=condition.stall,
        scale_rate=condition.scale_rate,
        scale_delay=condition.scale_delay,
        add_delay_ms=condition.add_delay_ns / NS_PER_MS,
        add_p_loss=condition.p_extra_loss,
        until_s=None if condition.until_ns >= FOREVER_NS else condition.until_ns / NS_PER_S,
        pipeline=link.rules.default,
        now=merged(link.rules.default, condition.changes),
        rules=rules,
        added=link.added,
        counters={name.removeprefix(f"{direction}."): count for name, count in link.counters.items()},
        delays=delays.get(direction),
    )
