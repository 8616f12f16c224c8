"""The conditions of a run with live changes, reconstructed from its log."""

from collections.abc import Iterable

from tis.common.channels import Direction
from tis.common.records import ControlNote
from tis.common.scenario.network import NetworkPart
from tis.netem.conditions.conditions import Condition, Conditions, Span
from tis.netem.control.notes import LiveChange, change_conditions, changes_from_notes


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
        return _joined(spans)

    def _begin(self) -> None:
        self._conditions = Conditions.of(self._network, self._direction, self._seed)
        self._n_applied = 0

    def _apply(self, change: LiveChange) -> None:
        change_conditions(self._conditions, self._direction, change.entries, change.cleared, change.at_ns)
        self._n_applied += 1


def _joined(spans: list[Span]) -> list[Span]:
    joined: list[Span] = []
    for span in spans:
        if joined and joined[-1][2:] == span[2:]:
            joined[-1] = joined[-1]._replace(end_ns=span.end_ns)
        else:
            joined.append(span)
    return joined
