"""Replay of live control: the changes of a run, read from its log and applied again to links or to conditions."""

import json
import re
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from typing import Final, NamedTuple

from pydantic_core import from_json

from tis.common.channels import Direction
from tis.common.errors import DataError, Fault
from tis.common.node import Arrival, Output, Record
from tis.common.records import CONTROL, ControlNote
from tis.common.scenario.control import CLEARING, OutageRequest, SetRequest
from tis.common.scenario.network import NetworkPart
from tis.common.scenario.network.conditions import BothOr, TimelineEntry
from tis.common.units import NS_PER_S
from tis.netem.conditions.conditions import Condition, Conditions, Span, joined
from tis.netem.link.link import Link
from tis.netem.node import NetemNode

_RESET: Final = "reset to what was asked for at the start"
_PROFILE: Final = re.compile(r'"profile"\s*:\s*"([^"]*)"')  # the request is logged truncated


class LiveChange(NamedTuple):
    """The effect of one accepted request at ``at_ns``: earlier entries ``cleared``, then ``entries`` added."""

    at_ns: int
    entries: tuple[TimelineEntry, ...]
    cleared: bool


def entries_json(entries: Sequence[TimelineEntry]) -> str:
    """Return entries as a JSON list for `changes_from_notes`; unset fields are left out."""
    return json.dumps([entry.model_dump(mode="json", exclude_unset=True) for entry in entries]) if entries else ""


def changes_from_notes(notes: Iterable[ControlNote]) -> list[LiveChange]:
    """Return the accepted changes in the order of application (oracle: the live links, test_notes).

    Raises `DataError` for a note without entries of a timeline.
    """
    return [
        LiveChange(note.at_ns, _entries(note.added or "[]"), note.operation in CLEARING)
        for note in notes
        if note.accepted
    ]


def _entries(text: str) -> tuple[TimelineEntry, ...]:
    try:
        return tuple(TimelineEntry.model_validate(entry) for entry in from_json(text))
    except (ValueError, TypeError):
        raise DataError(Fault(CONTROL, "added", "must be a JSON list of timeline entries", text)) from None


class MadeChange(NamedTuple):
    """A change made while running, in words: where, from when in ns, ``during`` which time, and ``what`` it set."""

    direction: BothOr
    begin_ns: int
    during: str
    what: str

    def __str__(self) -> str:
        """Return it on one line: ``forward, from 96.123 s for 10 s: delay 200 ms``."""
        where = "both directions" if self.direction == "both" else self.direction
        return f"{where}, {self.during}: {self.what}"


def made_changes(notes: Iterable[ControlNote]) -> list[MadeChange]:
    """Return each accepted change with its direction and time, in the order of the requests."""
    found = []
    for note in notes:
        if not note.accepted:
            continue
        named = _PROFILE.search(note.request) if note.operation == "profile" else None
        if note.operation in CLEARING:
            what = _RESET if named is None else f"profile {named[1]}, in place of what was set before"
            found.append(MadeChange("both", note.applied_ns, f"from {note.applied_ns / NS_PER_S:.3f} s", what))
        else:
            found += [_made(entry, note.applied_ns) for entry in _entries(note.added or "[]")]
    return found


def _made(entry: TimelineEntry, applied_ns: int) -> MadeChange:
    begin_ns = max(applied_ns, round(entry.at_s * NS_PER_S))
    return MadeChange(entry.direction, begin_ns, _during(entry), _set_in_words(entry))


def request_in_words(operation: str, text: str, at_s: float) -> str:
    """Return an accepted request as `made_changes` tells it; the text where it was cut and tells no profile.

    Oracle: requests in words, tests/netem/control/test_notes.
    """
    if operation in CLEARING:
        named = _PROFILE.search(text)
        return _RESET if named is None else f"profile {named[1]}"
    try:
        raw = from_json(text)
        if operation == "outage":
            sets = [OutageRequest.model_validate(raw).as_set()]
        else:
            sets = [SetRequest.model_validate(one) for one in (raw if isinstance(raw, list) else [raw])]
        return "; ".join(str(_made(one.entry(at_s), 0)) for one in sets)
    except ValueError:
        return text


def weightiest(changes: Sequence[str], most: int) -> list[str]:
    """Return at most ``most`` changes in words, in their order; an outage is kept before any other change."""
    by_weight = sorted(range(len(changes)), key=lambda k: "outage" not in changes[k].rpartition(": ")[2])
    return [changes[k] for k in sorted(by_weight[:most])]


def ways_past(n: int) -> str:
    """Return that ``n`` ways past netem were found."""
    return f"{n} way{'s' if n > 1 else ''} past netem found: not valid"


def entry_in_words(entry: TimelineEntry) -> str:
    """Return the time of a change and what it sets: ``from 96.123 s for 10 s: delay 200 ms``."""
    return f"{_during(entry)}: {_set_in_words(entry)}"


def _during(entry: TimelineEntry) -> str:
    length = "" if entry.for_s is None else f" for {entry.for_s:g} s"
    ramp = f", ramped for {entry.ramp_s:g} s" if entry.ramp_s else ""
    return f"from {entry.at_s:.3f} s{length}{ramp}"


def _set_in_words(entry: TimelineEntry) -> str:
    given = entry.set.model_dump(mode="json", exclude_unset=True)
    if given.get("stall") is True:
        given.pop("outage", None)  # false where an outage became a stall, as in a stream
    words = (name if value is True else f"{name} {_new_in_words(value)}" for name, value in given.items())
    return ", ".join(words)


def _new_in_words(value: object) -> str:
    """Return a stage as `value_in_words`; a constant delay, which most changes set, as its time."""
    match value:
        case {"kind": "constant", "delay_ms": delay_ms, **rest} if not rest:
            return f"{delay_ms:g} ms"
    return value_in_words(value)


def value_in_words(value: object) -> str:
    """Return a stage on one line: its kind, then names and values, a list by its length."""
    if isinstance(value, Mapping):
        kind = [str(value["kind"])] if "kind" in value else []
        named = (f"{name} {value_in_words(below)}" for name, below in value.items() if name != "kind")
        return " ".join([*kind, *named])
    if isinstance(value, list):
        return f"({len(value)} points)"
    if value is None:
        return "-"
    return f"{value:g}" if isinstance(value, float) else str(value).lower() if isinstance(value, bool) else str(value)


def apply_entries(
    links: Mapping[Direction, Link], entries: Sequence[TimelineEntry], cleared: bool, now_ns: int
) -> int:
    """Apply a request's changes to both links; return the instant from which the first one holds."""
    begins_ns: list[int] = []
    for link in links.values():
        link.catch_up(now_ns)  # earlier conditions may be forgotten
        begins_ns += change_conditions(link.conditions, link.direction, entries, cleared, now_ns)
        link.condition(now_ns)  # which also ends the link's cached one
    return min(begins_ns, default=now_ns)


def change_conditions(
    conditions: Conditions, direction: Direction, entries: Sequence[TimelineEntry], cleared: bool, now_ns: int
) -> list[int]:
    """Apply a request's changes to the conditions of one direction; return the instants from which they hold.

    An entry without an end supersedes what it names in earlier added entries without an end.
    """
    begins_ns = [conditions.clear_added(now_ns)] if cleared else []
    for entry in entries:
        if entry.direction in (direction, "both"):
            conditions.supersede(entry, now_ns)
            begins_ns.append(conditions.add(entry, now_ns))
    return begins_ns


class ChangedNode(NetemNode):
    """The emulator in virtual time with a live run's changes at the same run times; it logs them too.

    A change holds from the next ms, so it is enough to apply it before the first later packet, and before that ms
    where packets wait for a rate, which may change.
    """

    def __init__(self, node: NetemNode, notes: Iterable[ControlNote]) -> None:
        links = {link.direction: link for link in node.links.values()}
        super().__init__(**links, local=node.local)
        self._waiting = deque(sorted((note for note in notes if note.accepted), key=lambda note: note.at_ns))
        self._by_direction = links

    def receive(self, arrival: Arrival) -> Sequence[Output]:
        """Apply the changes of earlier instants, then decide the packet's fate."""
        return [*self._apply(arrival.recv_ns), *super().receive(arrival)]

    def wake(self, now_ns: int) -> Sequence[Output]:
        """Apply the changes until now, then release packets."""
        return [*self._apply(now_ns + 1), *super().wake(now_ns)]

    def next_wake_ns(self) -> int | None:
        """Return the next release, or the next change before it; None while nothing is held."""
        next_ns = super().next_wake_ns()
        return next_ns if next_ns is None or not self._waiting else min(next_ns, self._waiting[0].at_ns)

    def _apply(self, before_ns: int) -> list[Output]:
        """Apply the changes before an instant; return their records."""
        logged: list[Output] = []
        while self._waiting and self._waiting[0].at_ns < before_ns:
            note = self._waiting.popleft()
            (change,) = changes_from_notes([note])
            apply_entries(self._by_direction, change.entries, change.cleared, change.at_ns)
            logged.append(Record(CONTROL, note.at_ns, note))
        return logged

    def finish(self, now_ns: int) -> Sequence[Record]:
        """Return the last records, including changes after the last packet."""
        late = [Record(CONTROL, note.at_ns, note) for note in self._waiting]
        return [*late, *super().finish(now_ns)]


def with_live_changes(node: NetemNode, notes: Sequence[ControlNote]) -> NetemNode:
    """Return an emulator in its initial state that applies the accepted changes, if there are any."""
    return ChangedNode(node, notes) if any(note.accepted for note in notes) else node


def changed_conditions(
    network: NetworkPart, direction: Direction, seed: int, notes: Iterable[ControlNote]
) -> "Conditions | ChangedConditions":
    """Return the conditions of one direction, with the changes accepted during the run."""
    changes = changes_from_notes(notes)
    if not changes:
        return Conditions.of(network, direction, seed)
    return ChangedConditions(network, direction, seed, changes)


class ChangedConditions:
    """`Conditions` with changes applied at their run times; cheap for instants in ascending order.

    A live emulator forgets entries that have ended, so an earlier instant needs a new start.
    """

    is_constant = False

    def __init__(self, network: NetworkPart, direction: Direction, seed: int, changes: Iterable[LiveChange]) -> None:
        self._network = network
        self._seed = seed
        self._direction: Direction = direction
        self._changes = sorted(changes, key=lambda change: change.at_ns)
        self._begin()

    def at(self, now_ns: int) -> Condition:
        """Return the condition at ``now_ns``, until the next change at most (oracle: live links, test_notes)."""
        if self._n_applied and now_ns <= self._changes[self._n_applied - 1].at_ns:
            self._begin()
        while self._n_applied < len(self._changes) and self._changes[self._n_applied].at_ns < now_ns:
            self._apply(self._changes[self._n_applied])
        condition = self._conditions.at(now_ns)
        if self._n_applied < len(self._changes):
            return condition._replace(until_ns=min(condition.until_ns, self._changes[self._n_applied].at_ns + 1))
        return condition

    def spans(self, until_ns: int) -> list[Span]:
        """Return the spans from 0 until ``until_ns``, without gaps; an edge may lie where a change was requested."""
        self._begin()
        spans: list[Span] = []
        begin_ns = 0
        for change in [*self._changes, None]:
            end_ns = until_ns if change is None else min(until_ns, max(0, change.at_ns))
            news = [span for span in self._conditions.spans(end_ns) if span.end_ns > begin_ns]
            spans += [span._replace(begin_ns=max(begin_ns, span.begin_ns)) for span in news]
            begin_ns = end_ns
            if change is not None:
                self._apply(change)
        return joined(spans)

    def _begin(self) -> None:
        self._conditions = Conditions.of(self._network, self._direction, self._seed)
        self._n_applied = 0

    def _apply(self, change: LiveChange) -> None:
        change_conditions(self._conditions, self._direction, change.entries, change.cleared, change.at_ns)
        self._n_applied += 1
