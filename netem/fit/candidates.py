"""The choice of a fit: the simplest structure whose replays reproduce the record, else the one that misses least."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from math import inf
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tis.common.scenario.network import NetworkPart
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.netem.fit.backlogs import find_backlogs
from tis.netem.fit.closure import Closure, closures, replay, replays
from tis.netem.fit.cycle import Cycle, fit_cycle
from tis.netem.fit.direction import DirectionFit, FittedState, JointStates, change_of, earlier, fit_direction
from tis.netem.fit.half_life import fit_half_life
from tis.netem.fit.loss_chain import Bools, loss_stage
from tis.netem.fit.marginal import MarginalName
from tis.netem.fit.outages import find_stalls
from tis.netem.fit.record import DirectionRecord, rounded
from tis.netem.fit.steps import find_steps
from tis.netem.fit.switching import fit_switching, successors

REPLAYS: Final = 100
_CORRECTIONS: Final = 2
_PER_CORRECTION: Final = 4
_ENOUGH: Final = 200
_TRIALS: Final = 24
_FEWEST: Final = 20
_MAX_REPLAYED: Final = 10_000_000
"""Messages of all replays together; a longer record is replayed less often, at least 20 times."""
_MAX_QUEUED: Final = 2_000_000
"""The same for a fit with a queue, whose replays go message by message."""

_COMPLEX: Final = 1.0
"""Cost of a structure that needs states: a statistic that misses by half of the replays' spread, as chance may do."""

_WORST: Final = 3.0
_BY_QUEUE: Final = 0.3


def fit_closing(
    record: DirectionRecord, wanted: MarginalName | None = None, n: int = REPLAYS, with_states: bool = True
) -> DirectionFit:
    """Fit one direction, replay the fit, and take states or a cycle where the record asks for them.

    Parameters
    ----------
    record
        The record of one direction.
    wanted
        Family of the delays; None: the best one.
    n
        Number of replays; 0: none, and the first structure is taken.
    with_states
        False: no states, as the other direction has some.

    Returns
    -------
    DirectionFit
        With the comparison of record and replays in ``closures``.

    Raises
    ------
    ValueError
        If the record is too short.

    Notes
    -----
    Structures are tried in this order: one regime (with outages and bursts), stalls, backlogs of a queue,
    steps, a cycle, 2 and 3 Markov states. The first that closes is taken. Of a delay that varies no more than
    measuring may add, they are tried on the record without that. Oracle: records of other processes,
    tests/netem/fit/test_candidates.
    """
    first = fit_direction(record, wanted)
    if n == 0:
        return first
    n = min(n, max(_FEWEST, _MAX_REPLAYED // len(record.trace.sent_ns)))
    best, least, alone = first, inf, inf
    known = _without_what_measuring_added(record) if first.steady else record
    for fit in _structures(known, wanted, first, with_states):
        missed = misses(_compared(known, fit, min(n, _TRIALS))) + (_COMPLEX if fit.states else 0.0)
        if missed < least:
            best, least = fit, missed
        if fit is first:
            alone = missed
        # a cycle that explains most of what one regime misses is none of Markov's
        cycles = fit.states is not None and fit.states.kind == "cycle" and missed <= alone / 2
        if missed <= _COMPLEX or cycles:
            break
    if best.backlogs is not None:
        n = min(n, max(_FEWEST, _MAX_QUEUED // len(record.trace.sent_ns)))
    return best._replace(closures=_compared(record, best, n), n_replays=n)


def _without_what_measuring_added(record: DirectionRecord) -> DirectionRecord:
    """Return the record of a steady delay: what measuring may have added is neither a state nor a stall."""
    trace = record.trace
    middle_ns = int(np.median(trace.delay_ns[trace.delay_ns >= 0]))
    added = (trace.delay_ns >= 0) & (np.abs(trace.delay_ns - middle_ns) <= record.adds.nearly_all_ns)
    return replace(record, trace=replace(trace, delay_ns=np.where(added, middle_ns, trace.delay_ns)))


def misses(compared: tuple[Closure, ...]) -> float:
    """Return by how much a fit misses: twice the excess of each severity over 1, at most 3 for each statistic."""
    return float(sum(min(max(0.0, 2 * (one.severity - 1.0)), _WORST) for one in compared))


def _compared(record: DirectionRecord, fit: DirectionFit, n: int) -> tuple[Closure, ...]:
    return closures(record.trace, replays(fit.network("forward"), record.trace, n, not record.drawn))


def _structures(
    record: DirectionRecord, wanted: MarginalName | None, first: DirectionFit, with_states: bool
) -> Iterator[DirectionFit]:
    yield first
    more: list[Callable[[], DirectionFit | None]] = [
        lambda: _with_stalls(record, wanted),
        lambda: with_backlogs(record, wanted),
        lambda: _with_steps(record, wanted),
    ]
    if with_states:
        more += [
            lambda: _with_cycle(record, wanted),
            lambda: _with_states(record, wanted, first, 2),
            lambda: _with_states(record, wanted, first, 3),
        ]
    for make in more:
        try:
            found = make()
        except ValueError:  # too little is left of the record for the structure
            continue
        if found is not None:
            yield found


def _with_stalls(record: DirectionRecord, wanted: MarginalName | None) -> DirectionFit | None:
    stalls = None if record.drawn else find_stalls(record.trace)
    if stalls is None:
        return None
    # what came out of a stall was held up by the slowest of it: it tells nothing of the delays
    rest = replace(record, trace=stalls.removed_from(record.trace))
    return fit_direction(rest, wanted, stalls.wait_ns == 0)._replace(stalls=stalls)


def with_backlogs(record: DirectionRecord, wanted: MarginalName | None) -> DirectionFit | None:
    """Return the fit of a rate and its queue, None where the record has no backlogs."""
    backlogs = None if record.drawn else find_backlogs(record.trace)
    if backlogs is None:
        return None
    rest = replace(record, trace=backlogs.removed_from(record.trace))
    base = fit_direction(rest, wanted, ~backlogs.within)
    fit = base._replace(stages={**base.stages, "rate": backlogs.stage}, backlogs=backlogs)
    lost = record.trace.delay_ns < 0
    if "max_bytes" not in backlogs.stage.get("queue", {}) or "loss" in base.stages:
        return fit
    # such a queue drops few messages as short as these: what is lost beyond it has another reason
    by_queue = replay(NetworkPart.model_validate(fit.network("forward")), record.trace, 1, not record.drawn) < 0
    kept = ~base.outages.within
    loss = loss_stage(lost[kept], np.diff(np.flatnonzero(kept)) == 1)
    if loss is None or by_queue.sum() > _BY_QUEUE * lost.sum():
        return fit
    return fit._replace(stages={**fit.stages, "loss": loss})


def _with_steps(record: DirectionRecord, wanted: MarginalName | None) -> DirectionFit | None:
    steps = find_steps(record.trace)
    if steps is None:
        return None
    return fit_direction(replace(record, trace=steps.removed_from(record.trace)), wanted)._replace(steps=steps)


def _with_cycle(record: DirectionRecord, wanted: MarginalName | None) -> DirectionFit | None:
    cycle = fit_cycle(record.trace)
    if cycle is None:
        return None
    trace = record.trace
    base = fit_direction(record, wanted, cycle.leaf == cycle.base)
    kept = ~base.outages.within
    states = []
    in_base = trace.delay_ns[(cycle.leaf == cycle.base) & kept]
    coherent = _coherence(record, cycle, kept & (cycle.leaf != cycle.base))
    for number, (length_s, leaf) in enumerate(zip(cycle.lengths_s, cycle.leaves, strict=True)):
        change: dict[str, Any] = {}
        if leaf != cycle.base:
            change = change_of(trace.delay_ns[kept & (cycle.leaf == leaf)], in_base)
            if coherent is not None and change.get("delay", {}).get("kind") == "quantiles":
                change["correlation"] = {"half_life_s": coherent}
        states.append(FittedState(f"phase_{number + 1}", {"for_s": length_s}, change))
    states = _corrected(record, base, cycle, states)
    note = f"a cycle of {sum(cycle.lengths_s):.6g} s, seen {cycle.n_cycles} times"
    return base._replace(states=JointStates("cycle", tuple(states), note))


def _corrected(
    record: DirectionRecord, base: DirectionFit, cycle: Cycle, states: list[FittedState]
) -> list[FittedState]:
    """Return the states with delays reduced by what waiting for earlier messages adds to them in replays.

    The record's delays include that wait. Parts of a stall follow each other so closely that it would count twice.
    """
    if record.drawn or "ordering" in base.stages:
        return states
    trace = record.trace
    mean_ms = _leaf_means(cycle, trace.delay_ns)
    drawn = list(states)
    for _ in range(_CORRECTIONS):
        network = base._replace(states=JointStates("cycle", tuple(drawn), "")).network("forward")
        model = NetworkPart.model_validate(network)
        found = [
            _leaf_means(cycle, replay(model, trace, seed, ordered=True)) for seed in range(1, _PER_CORRECTION + 1)
        ]
        excess_ms = np.mean([np.where(np.isnan(one), mean_ms, one) for one in found], axis=0) - mean_ms
        for number, leaf in enumerate(cycle.leaves):
            if leaf != cycle.base and excess_ms[leaf] > 0:
                state = drawn[number]
                drawn[number] = state._replace(change=earlier(state.change, float(excess_ms[leaf])))
    return drawn


def _leaf_means(cycle: Cycle, delay_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the mean delay in ms of each leaf's messages, nan without any."""
    arrived = delay_ns >= 0
    n_leaves = max(cycle.leaves) + 1
    n = np.bincount(cycle.leaf[arrived], minlength=n_leaves)
    total = np.bincount(cycle.leaf[arrived], delay_ns[arrived] / NS_PER_MS, n_leaves)
    means: NDArray[np.float64] = np.divide(total, n, out=np.full(n_leaves, np.nan), where=n > 0)
    return means


def _coherence(record: DirectionRecord, cycle: Cycle, within: Bools) -> float | None:
    """Return the half-life in s of the delays' ranks in their part of the cycle; None where none is found.

    Ranks that hold for about as long as the stretch itself are those of one draw in each period, such as the length
    of a stall: they hold throughout, and are forgotten by the next period.
    """
    arrived = np.flatnonzero(within & (record.trace.delay_ns >= 0))
    ranks = np.zeros(len(arrived))
    for number in np.unique(cycle.leaf[arrived]):
        which = np.flatnonzero(cycle.leaf[arrived] == number)
        order = np.argsort(np.argsort(record.trace.delay_ns[arrived][which], kind="stable"), kind="stable")
        ranks[which] = (order + 0.5) / len(which)
    half_life = fit_half_life(record.trace.sent_ns[arrived], np.rint(ranks * NS_PER_S).astype(np.int64))
    if half_life.seconds is None and len(arrived) >= _ENOUGH:
        return None
    found = inf if half_life.seconds is None else half_life.seconds  # too few to tell: one draw in each period
    stretch_s = sum(length for length, leaf in zip(cycle.lengths_s, cycle.leaves, strict=True) if leaf != cycle.base)
    at_once = found > stretch_s / 2
    return rounded(max(sum(cycle.lengths_s) / 4 if at_once else found, 0.001))


def _with_states(
    record: DirectionRecord, wanted: MarginalName | None, first: DirectionFit, n_states: int
) -> DirectionFit | None:
    trace = record.trace
    kept = np.flatnonzero(~first.outages.within)
    sent_ns, delay_ns = trace.sent_ns[kept], trace.delay_ns[kept]
    model = fit_switching(sent_ns, delay_ns, np.diff(kept) == 1, n_states)
    if model is None or len(np.unique(model.path)) < n_states:
        return None
    regime = np.zeros(len(trace.sent_ns), dtype=np.bool_)
    regime[kept[: len(model.path)][model.path == 0]] = True
    base = fit_direction(record, wanted, regime)
    stages = dict(base.stages)
    arrived = ~np.isnan(model.scores)
    half_life = fit_half_life(
        sent_ns[: len(arrived)][arrived], np.rint(model.scores[arrived] * NS_PER_MS).astype(np.int64)
    )
    stages.pop("correlation", None)
    if half_life.seconds is not None and base.marginal.chosen != "constant":
        stages["correlation"] = {"half_life_s": rounded(half_life.seconds)}
    names = ["good", "bad", "other"][:n_states]
    interval_s = float(np.median(np.diff(sent_ns))) / NS_PER_S
    durations = successors(model.transition, names, interval_s)
    states = []
    for state, (name, duration) in enumerate(zip(names, durations, strict=True)):
        of = delay_ns[: len(model.path)][model.path == state]
        change = {} if state == 0 else change_of(of, trace.delay_ns[regime])
        states.append(FittedState(name, duration, change))
    note = f"a hidden Markov model of {n_states} states"
    return base._replace(stages=stages, half_life=half_life, states=JointStates("markov", tuple(states), note))
