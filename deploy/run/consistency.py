"""Comparison of a live run's fates with the twin's (L1): loss, delay, copies and corruption, packet by packet."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final, get_args

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Direction
from tis.common.records import CONTROL, Outcome
from tis.common.scenario import Scenario
from tis.common.scenario.network.pipeline import Pipeline
from tis.common.streams import Address
from tis.common.units import NS_PER_MS
from tis.deploy.logs.read.frame import Frame
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.packets import DELIVER, by_key, link_fates
from tis.deploy.logs.read.side_log import OUTCOMES
from tis.deploy.report.subjects.network.requested import Requested
from tis.netem.conditions.conditions import merged
from tis.netem.stages.impairment import Impairment
from tis.netem.stages.pipeline_draws import Draw

# Expected fates: the decisions of a scenario's models at the instants at which a run offered its packets.

_CODES: Final = {name: code for code, name in enumerate(OUTCOMES)}


def expected_fates(request: Requested, seed: int, direction: Direction, key: str, fates: Frame) -> Frame | None:
    """Return N packets of one key with the fates that the models give them; None without a trace or a pipeline.

    Outcome, delay, copies and flipped bits follow from the sequence number and from the ms of run time at which each
    packet was offered, under the conditions of that ms: the decisions of a twin offered the packets at the same
    instants. A refused key has no pipeline. Oracle: `tis.netem.expected.simulate`, test_consistency.
    """
    pipeline = request.pipeline(key)
    held = request.in_force(fates.offered_ns)
    if pipeline is None or any(request.under(key, condition.changes) is None for condition in held.conditions):
        return None
    impairment = Impairment(pipeline, Address(seed, direction, key), request.traces)
    rows = zip(
        fates.seq.tolist(), fates.offered_ns.tolist(), fates.n_bytes.tolist(), held.which.tolist(), strict=True
    )
    decided = [
        _columns(impairment.decide(seq, at_ns, n_bytes, held.conditions[which]))
        for seq, at_ns, n_bytes, which in rows
    ]
    outcome, delay_ns, copies, flipped, recovered = np.array(decided, dtype=np.int64).reshape(-1, 5).T
    return fates.with_columns(outcome=outcome, delay_ns=delay_ns, copies=copies, flipped=flipped, recovered=recovered)


def _columns(drawn: Draw | Outcome) -> tuple[int, int, int, int, int]:
    if isinstance(drawn, str):
        return _CODES[drawn], 0, 0, 0, 0
    return DELIVER, drawn.delay_ns, int(drawn.copy_delay_ns is not None), drawn.n_flips, int(drawn.is_lost)


_NOT_DRAWN: Final = tuple(OUTCOMES.index(name) for name in ("queue_full", "overflow"))
_LOST: Final = tuple(OUTCOMES.index(name) for name in ("loss", "outage", "refused"))


@dataclass(frozen=True)
class FateComparison:
    """Packets of two runs of one scenario, matched by direction, key and sequence number.

    The host's jitter may offer a packet in another ms of run time. Where the draws depend on run time (correlated
    delays, traces by time, and conditions: outages, states, timeline, changes made while running), such a packet has
    *moved*, and the two fates need not be equal: each is compared with the models at its own ms instead, and the
    packet counts as compared. Set aside are only packets offered after a change that the twin did not make, and moved
    packets whose trace is missing.
    """

    n_compared: int
    n_different: int
    n_moved: int
    n_set_aside: int
    n_in_one_only: int

    @property
    def identical(self) -> bool:
        """Tell whether every packet that both runs offered had the same fate."""
        return self.n_compared > 0 and self.n_different == 0

    @property
    def set_aside_share(self) -> float:
        """Return the share of the packets of both runs that could not be compared."""
        n_both = self.n_compared + self.n_set_aside
        return self.n_set_aside / n_both if n_both else 0.0


def compare_fates(live: RunLogs, twin: RunLogs, scenario: Scenario) -> FateComparison:
    """Compare the models' decisions: loss, drawn delay, copies and flipped bits.

    Release instants, and drops by queues, ordering and a full buffer, follow from the arrivals and are excluded. Of
    a packet dropped by a full buffer or queue only the models' loss is compared; copies only without a rate.
    Oracle: hand-made logs, test_consistency.
    """
    counts = np.zeros(5, dtype=np.int64)
    for direction in get_args(Direction):
        request = Requested.of(scenario, direction, live)
        decide = partial(expected_fates, request, scenario.seed, direction)
        one, other = (_by_key(link_fates(logs, direction)) for logs in (live, twin))
        first_ns = min(_first_change_ns(live), _first_change_ns(twin))
        same_changes = _changes(live) == _changes(twin)
        for key in dict.fromkeys((*one, *other)):
            counts += _compared(key, one.get(key), other.get(key), request, decide, first_ns, same_changes)
    return FateComparison(*counts.tolist())


def _by_key(fates: Frame) -> Mapping[str, Frame]:
    ours = fates.at(~fates.foreign)
    places = zip(ours.keys, by_key(ours.key, len(ours.keys)), strict=True)
    return {key: ours.at(which) for key, which in places if len(which)}


def _first_change_ns(logs: RunLogs) -> float:
    """Return when the first change made while running took effect, ns of run time; infinity without one."""
    return min((note["applied_ns"] for note in logs.of("netem", CONTROL) if note["accepted"]), default=np.inf)


def _changes(logs: RunLogs) -> list[tuple[int, str, str]]:
    """Return the changes made while running: instant, operation, content."""
    notes = (note for note in logs.of("netem", CONTROL) if note["accepted"])
    return [(note["at_ns"], note["operation"], note["added"]) for note in notes]


def _compared(
    key: str, one: Frame | None, other: Frame | None, request: Requested,
    decide: Callable[[str, Frame], Frame | None], changed_ns: float, same_changes: bool,
) -> NDArray[np.int64]:  # fmt: skip
    """Return how many packets were compared, differ, moved, were set aside, and are in one run only.

    ``decide`` gives packets the models' fates at their own instants, None when a trace is missing.
    """
    if one is None or other is None:
        present = one if one is not None else other
        return np.array([0, 0, 0, 0, 0 if present is None else len(np.unique(present.seq))])
    # packets of both runs, row by row
    seq, here, there = np.intersect1d(one.seq, other.seq, return_indices=True)
    n_alone = len(np.union1d(one.seq, other.seq)) - len(seq)
    a, b = one.at(here), other.at(there)
    # a change in one run only makes every later packet incomparable
    aside = (np.maximum(a.offered_ns, b.offered_ns) >= changed_ns) & (not same_changes)
    base = request.pipeline(key)
    with_copies = base is not None and base.rate is None and not request.may_limit_rate
    moved = _moved(key, a, b, request) & ~aside
    different = _different(a, b, with_copies) & ~aside & ~moved
    # A moved packet is right in either run when the models, evaluated at its own ms, decide the same.
    if moved.any():
        again = [(run.at(moved), decide(key, run.at(moved))) for run in (a, b)]
        wrong = [_different(was, is_, with_copies) for was, is_ in again if is_ is not None]
        if len(wrong) < len(again):
            aside, moved = aside | moved, np.zeros_like(moved)
        else:
            different[moved] = wrong[0] | wrong[1]
    return np.array([len(seq) - aside.sum(), different.sum(), moved.sum(), aside.sum(), n_alone])


def _different(a: Frame, b: Frame, with_copies: bool) -> NDArray[np.bool_]:
    no_room = np.isin(a.outcome, _NOT_DRAWN) | np.isin(b.outcome, _NOT_DRAWN)
    lost = np.isin(a.outcome, _LOST) != np.isin(b.outcome, _LOST)
    drawn = (a.outcome != b.outcome) | (a.delay_ns != b.delay_ns) | (a.flipped != b.flipped)
    if with_copies:
        drawn |= a.copies != b.copies
    return np.asarray(np.where(no_room, lost, drawn))


def _moved(key: str, a: Frame, b: Frame, request: Requested) -> NDArray[np.bool_]:
    """Mark the packets offered in different ms of run time whose draws depend on run time."""
    moved = np.asarray(a.offered_ns // NS_PER_MS != b.offered_ns // NS_PER_MS)
    base = request.pipeline(key)
    if base is None or not moved.any():
        return np.zeros(len(moved), dtype=np.bool_)
    held = request.in_force(np.concatenate([a.offered_ns[moved], b.offered_ns[moved]]))
    before, after = np.split(held.which, 2)
    by_time = np.array([_depends_on_time(merged(base, condition.changes)) for condition in held.conditions])
    moved[moved] = (before != after) | by_time[before]
    return moved


def _depends_on_time(pipeline: Pipeline) -> bool:
    parts = (part for part in (pipeline.delay, pipeline.loss) if part is not None and part.kind == "trace")
    return pipeline.correlation is not None or any(part.advance == "time" for part in parts)
