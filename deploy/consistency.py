"""Live fates against the twin's (L1): the same packet, lost, late, copied and corrupted alike, in both."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, get_args

import numpy as np
from numpy.typing import NDArray

from common.channels import Direction
from common.records import CONTROL
from common.scenario import Scenario
from common.scenario.network.pipeline import Pipeline
from common.units import NS_PER_MS
from deploy.report.batches import OUTCOMES, Fates, by_key, link_fates
from deploy.report.load import RunLogs
from deploy.report.requested import Requested
from netem.conditions import merged

_NOT_DRAWN: Final = tuple(OUTCOMES.index(name) for name in ("queue_full", "overflow"))
_LOST: Final = tuple(OUTCOMES.index(name) for name in ("loss", "outage", "refused"))


@dataclass(frozen=True)
class FateComparison:
    """Packets of two runs of one scenario, matched by direction, key and sequence number.

    Set aside are packets that the two runs offered in different ms of run time, where what is asked for depends on
    that: other conditions (outages, states, timeline, changes made while running), correlated delays, traces by time.
    The host's jitter may move a packet over an edge. When the twin did not make the same changes while running, all
    that was offered after the first of them is set aside.
    """

    n_compared: int
    n_different: int
    n_set_aside: int
    n_in_one_only: int

    @property
    def identical(self) -> bool:
        """Tell whether every packet that both runs offered had one fate."""
        return self.n_compared > 0 and self.n_different == 0


def compare_fates(live: RunLogs, twin: RunLogs, scenario: Scenario) -> FateComparison:
    """Compare what the models decided: lost or not, the delay drawn, copies made, bits flipped.

    Release instants, and what queues, ordering and a full buffer dropped, follow from the arrivals and are left out:
    of a packet that found no room only its being lost by no model is compared, and copies only without a rate.
    Oracle: hand-made logs, test_consistency.
    """
    counts = np.zeros(4, dtype=np.int64)
    for direction in get_args(Direction):
        request = Requested.of(scenario, direction, live)
        one, other = (_by_key(link_fates(logs, direction)) for logs in (live, twin))
        first_ns = min(_changed_ns(live), _changed_ns(twin))
        alike = _changes(live) == _changes(twin)
        for key in dict.fromkeys((*one, *other)):
            counts += _compared(key, one.get(key), other.get(key), request, first_ns, alike)
    return FateComparison(*counts.tolist())


def _by_key(fates: Fates) -> Mapping[str, Fates]:
    ours = fates.at(~fates.foreign)
    places = zip(ours.keys, by_key(ours.key, len(ours.keys)), strict=True)
    return {key: ours.at(which) for key, which in places if len(which)}


def _changed_ns(logs: RunLogs) -> float:
    """Return when the first change that was made while running took hold."""
    return min((note["applied_ns"] for note in logs.of("netem", CONTROL) if note["accepted"]), default=np.inf)


def _changes(logs: RunLogs) -> list[tuple[int, str, str]]:
    """Return what was changed while running, and when."""
    notes = (note for note in logs.of("netem", CONTROL) if note["accepted"])
    return [(note["at_ns"], note["operation"], note["added"]) for note in notes]


def _compared(
    key: str, one: Fates | None, other: Fates | None, request: Requested, changed_ns: float, alike: bool
) -> NDArray[np.int64]:
    """Return how many packets were compared, differ, were set aside, and are in one run only."""
    if one is None or other is None:
        present = one if one is not None else other
        return np.array([0, 0, 0, 0 if present is None else len(np.unique(present.seq))])
    seq, here, there = np.intersect1d(one.seq, other.seq, return_indices=True)
    n_alone = len(np.union1d(one.seq, other.seq)) - len(seq)
    a, b = one.at(here), other.at(there)
    unlike = (np.maximum(a.offered_ns, b.offered_ns) >= changed_ns) & (not alike)
    aside = _aside(key, a, b, request) | unlike
    different = _different(a, b, with_copies=not _has_rate(key, request)) & ~aside
    return np.array([len(seq) - aside.sum(), different.sum(), aside.sum(), n_alone])


def _different(a: Fates, b: Fates, with_copies: bool) -> NDArray[np.bool_]:
    no_room = np.isin(a.outcome, _NOT_DRAWN) | np.isin(b.outcome, _NOT_DRAWN)
    lost = np.isin(a.outcome, _LOST) != np.isin(b.outcome, _LOST)
    drawn = (a.outcome != b.outcome) | (a.delay_ns != b.delay_ns) | (a.flipped != b.flipped)
    if with_copies:
        drawn |= a.copies != b.copies
    return np.asarray(np.where(no_room, lost, drawn))


def _aside(key: str, a: Fates, b: Fates, request: Requested) -> NDArray[np.bool_]:
    """Mark the packets that were offered in different cells of run time, where that may matter."""
    moved = np.asarray(a.offered_ns // NS_PER_MS != b.offered_ns // NS_PER_MS)
    if not moved.any():
        return np.zeros(len(moved), dtype=np.bool_)
    base = request.pipeline(key)
    held = request.in_force(np.concatenate([a.offered_ns[moved], b.offered_ns[moved]]))
    before, after = np.split(held.which, 2)
    by_time = np.array(
        [base is not None and _goes_by_time(merged(base, condition.changes)) for condition in held.conditions]
    )
    aside = np.zeros(len(moved), dtype=np.bool_)
    aside[moved] = (before != after) | by_time[before]
    return aside


def _goes_by_time(pipeline: Pipeline) -> bool:
    parts = (part for part in (pipeline.delay, pipeline.loss) if part is not None and part.kind == "trace")
    return pipeline.correlation is not None or any(part.advance == "time" for part in parts)


def _has_rate(key: str, request: Requested) -> bool:
    base = request.pipeline(key)
    return base is None or base.rate is not None or request.may_limit_rate
