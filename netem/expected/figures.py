"""The requested figures of a network, from its models: mean, quantiles, loss, bursts and outages by direction."""

from collections.abc import Iterator, Mapping
from math import prod, sqrt
from typing import Final, NamedTuple

import numpy as np

from tis.common.channels import Direction
from tis.common.scenario.network import NetworkPart
from tis.common.scenario.network.conditions import Change, CycleStates, Effect
from tis.common.trace import Trace
from tis.common.units import NS_PER_MS
from tis.netem.conditions.conditions import merged
from tis.netem.conditions.outage import outage_share
from tis.netem.conditions.states import state_shares
from tis.netem.conditions.steps import levels_ms
from tis.netem.stages.delay import LatencyModel, latency_of
from tis.netem.stages.loss import expected_loss

_GRID: Final = 4000
_COARSE_GRID: Final = 400
_NOTHING_ARRIVES: Final = (float("nan"), float("nan"), float("nan"), float("nan"))


class DirectionFigures(NamedTuple):
    """Long-run figures of one direction, without ordering, queues, stalls and timeline; delays of arriving messages.

    ``loss_pct`` is the share of messages offered outside outages, ``outage_pct`` and ``stall_pct`` are the shares of
    time in an outage and in a stall.
    ``recovered_pct`` is the share of messages whose first sending is lost and repeated; how late they are, and what
    waits behind them, depends on the message rate (`tis.netem.expected.simulate`).
    ``own_loss_pct`` and ``added_loss_pct`` are the shares of the loss stage and of what states add, which is of whole
    messages also where the stage's is of packets.
    ``mean_burst`` is None if it depends on the message rate, and 0 without losses.
    """

    mean_ms: float
    std_ms: float
    p50_ms: float
    p99_ms: float
    loss_pct: float
    mean_burst: float | None
    outage_pct: float
    stall_pct: float
    recovered_pct: float = 0.0
    own_loss_pct: float = 0.0
    added_loss_pct: float = 0.0


class _Regime(NamedTuple):
    """The models that apply for a share of the time."""

    share: float
    latency: LatencyModel
    scale: float
    add_ms: float
    p_loss: float
    mean_burst: float | None
    p_recovered: float
    p_own: float
    p_added: float


def direction_figures(
    network: NetworkPart, direction: Direction, traces: Mapping[str, Trace] | None = None
) -> DirectionFigures:
    """Return the figures of one direction; ``traces`` by the paths that the network names.

    They are exact for one regime; with states, the quantiles are those of the mixture on a grid of 4000 equal shares
    of each state, of 400 with jitter. Oracle: long simulations, tests/netem/expected/test_figures.
    """
    up, p_state_out = _regimes(network, direction, traces or {})
    outage = 1 - _share_without(network, direction, "loss") * (1 - p_state_out)
    in_stall = sum(share for share, change in _changes(network, direction) if change.stall)
    stall = 1 - _share_without(network, direction, "stall") * (1 - in_stall)
    total = sum(regime.share for regime in up)
    if total == 0:
        return DirectionFigures(*_NOTHING_ARRIVES, 0.0, 0.0, 100.0, 100 * stall)
    loss = sum(regime.share * regime.p_loss for regime in up) / total
    bursts = {regime.mean_burst for regime in up} if network.states is None else {None}
    burst = bursts.pop() if len(bursts) == 1 and (loss > 0 or network.states is None) else 0.0
    arriving = [(regime.share * (1 - regime.p_loss), regime) for regime in up]
    shares = ((regime.share / total, (regime.p_recovered, regime.p_own, regime.p_added)) for regime in up)
    parts_pct = (100 * sum(each) for each in zip(*([share * p for p in of] for share, of in shares), strict=True))
    return DirectionFigures(*_delays(arriving), 100 * loss, burst, 100 * outage, 100 * stall, *parts_pct)


def _share_without(network: NetworkPart, direction: Direction, effect: Effect) -> float:
    """Return the share of time without recurring outages of an effect."""
    parts = (part for part in network.outages if part.effect == effect and part.direction in (direction, "both"))
    return prod(1 - outage_share(part) for part in parts)


def _regimes(network: NetworkPart, direction: Direction, traces: Mapping[str, Trace]) -> tuple[list[_Regime], float]:
    """Return the regimes with their shares of time, and the share of states that are an outage."""
    pipeline = network.forward if direction == "forward" else network.feedback
    up, p_out = [], 0.0
    for share, change in _changes(network, direction):
        if change.outage:
            p_out += share
            continue
        stages = merged(pipeline, (change,))
        own = expected_loss(stages.loss, traces)
        p_loss = 1 - (1 - own.p_loss) * (1 - change.add_p_loss)
        burst = own.mean_burst if change.add_p_loss == 0 else None
        latency = latency_of(stages, traces)
        p_recovered, parts = 0.0, (own.p_loss, change.add_p_loss)
        if stages.recovery is not None:
            p_recovered, p_loss, burst = p_loss, 0.0, 0.0
        levels = levels_ms(network.steps, direction)
        added_ms, of_each = (change.add_delay_ms + levels).tolist(), share / len(levels)
        up += [
            _Regime(of_each, latency, change.scale_delay, ms, p_loss, burst, p_recovered, *parts) for ms in added_ms
        ]
    return up, p_out


def _changes(network: NetworkPart, direction: Direction) -> Iterator[tuple[float, Change]]:
    states = network.states
    if states is None:
        yield 1.0, Change()
        return
    if isinstance(states, CycleStates):  # a cycle may contain a state twice
        length_s = sum(state.for_s for state in states.states)
        shares = [state.for_s / length_s for state in states.states]
    else:
        by_name = state_shares(states)
        shares = [by_name[state.name] for state in states.states]
    for state, share in zip(states.states, shares, strict=True):
        if share > 0:
            yield share, state.forward if direction == "forward" else state.feedback


def _delays(arriving: list[tuple[float, _Regime]]) -> tuple[float, float, float, float]:
    """Return mean, standard deviation, p50 and p99 in ms of a mixture of regimes with these weights."""
    total = sum(weight for weight, _ in arriving)
    if total == 0:
        return _NOTHING_ARRIVES
    weights = np.array([weight / total for weight, _ in arriving])
    means = np.array([r.scale * r.latency.mean_ns / NS_PER_MS + r.add_ms for _, r in arriving])
    stds = np.array([r.scale * r.latency.std_ns / NS_PER_MS for _, r in arriving])
    mean = float(weights @ means)
    std = sqrt(float(weights @ (stds**2 + (means - mean) ** 2)))
    if len(arriving) == 1:
        only = arriving[0][1]
        p50, p99 = (only.scale * q / NS_PER_MS + only.add_ms for q in only.latency.quantiles_ns((0.5, 0.99)))
        return mean, std, p50, p99
    n = _GRID if all(r.latency.jitter is None for _, r in arriving) else _COARSE_GRID
    of = {id(r.latency): r.latency for _, r in arriving}  # steps and states share one
    shares_ns = {key: latency.shares_ns(n) for key, latency in of.items()}
    values = np.concatenate([r.scale * shares_ns[id(r.latency)] / NS_PER_MS + r.add_ms for _, r in arriving])
    order = np.argsort(values)
    upto = np.cumsum(np.repeat(weights / n, n)[order])
    p50, p99 = (float(values[order[np.searchsorted(upto, share)]]) for share in (0.5, 0.99))
    return mean, std, p50, p99
