"""From the log of a run back to the changes that were made while it lasted, to make them again in virtual time."""

import json
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from common.channels import Direction
from common.node import Arrival, Output, Record
from common.records import CONTROL, ControlNote
from common.scenario.control import CLEARING
from common.scenario.network.conditions import TimelineEntry
from netem.conditions.conditions import Conditions
from netem.link.link import Link
from netem.node import NetemNode


class LiveChange(NamedTuple):
    """What one accepted request did at ``at_ns``: what had been added cleared, if so, and then entries added."""

    at_ns: int
    entries: tuple[TimelineEntry, ...]
    cleared: bool


def entries_json(entries: Sequence[TimelineEntry]) -> str:
    """Return entries as a JSON list that `changes_from_notes` reads; what was not given stays out."""
    return json.dumps([entry.model_dump(mode="json", exclude_unset=True) for entry in entries]) if entries else ""


def changes_from_notes(notes: Iterable[ControlNote]) -> list[LiveChange]:
    """Return what was accepted, in the order in which it was done (oracle: the live links, test_control_notes)."""
    return [
        LiveChange(
            note.at_ns,
            tuple(TimelineEntry.model_validate(entry) for entry in json.loads(note.added or "[]")),
            note.operation in CLEARING,
        )
        for note in notes
        if note.accepted
    ]


def repeat(links: Mapping[Direction, Link], entries: Sequence[TimelineEntry], cleared: bool, now_ns: int) -> int:
    """Do to both links what a request asks for; return the instant from which the first of it holds."""
    begins_ns: list[int] = []
    for link in links.values():
        begins_ns += change_conditions(link.conditions, link.direction, entries, cleared, now_ns)
        link.change((), now_ns)
    return min(begins_ns, default=now_ns)


def change_conditions(
    conditions: Conditions, direction: Direction, entries: Sequence[TimelineEntry], cleared: bool, now_ns: int
) -> list[int]:
    """Do to the conditions of one direction what a request asks for; return the instants from which it holds.

    An entry without an end takes the place of what was added before without one.
    """
    begins_ns = [conditions.clear_added(now_ns)] if cleared else []
    for entry in entries:
        if entry.direction in (direction, "both"):
            conditions.supersede(entry, now_ns)
            begins_ns.append(conditions.add(entry, now_ns))
    return begins_ns


class RepeatedNode(NetemNode):
    """The emulator in virtual time to which a live run's changes are made again at the same run times, and logged.

    A change holds from the next ms on, so it is enough to make it before the first packet that comes later.
    """

    def __init__(self, forward: Link, feedback: Link, notes: Iterable[ControlNote]) -> None:
        super().__init__(forward, feedback)
        self._waiting = deque(sorted((note for note in notes if note.accepted), key=lambda note: note.at_ns))
        self._by_direction = {link.direction: link for link in (forward, feedback)}

    def receive(self, arrival: Arrival) -> Sequence[Output]:
        """Make the changes of earlier instants, then decide the packet's fate."""
        made: list[Output] = []
        while self._waiting and self._waiting[0].at_ns < arrival.recv_ns:
            note = self._waiting.popleft()
            (change,) = changes_from_notes([note])
            repeat(self._by_direction, change.entries, change.cleared, change.at_ns)
            made.append(Record(CONTROL, note.at_ns, note))
        return [*made, *super().receive(arrival)]

    def finish(self, now_ns: int) -> Sequence[Record]:
        """Return the last records; changes that came after the last packet are logged, too."""
        late = [Record(CONTROL, note.at_ns, note) for note in self._waiting]
        return [*late, *super().finish(now_ns)]


def repeated(node: NetemNode, notes: Sequence[ControlNote]) -> NetemNode:
    """Return an emulator in its initial state as one to which the changes are made again, if there are any."""
    links = {link.direction: link for link in node.links.values()}
    return RepeatedNode(**links, notes=notes) if any(note.accepted for note in notes) else node
