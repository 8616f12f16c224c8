"""The requested figures of a network, from its models, and the line of each direction that states them.

The figures are mean, quantiles, loss, bursts and outages by direction. The lines are printed before the first message
passes.
"""

from collections.abc import Iterator, Mapping, Sequence
from math import isfinite, isnan, prod, sqrt
from typing import Final, NamedTuple, get_args

import numpy as np

from tis.common.channels import DESTINATION, ORIGIN, Direction
from tis.common.scenario.network import NetworkPart
from tis.common.scenario.network.capacity import MAX_COUNT, Capacity, CoDel, Cross, Queue, RecordedRate
from tis.common.scenario.network.conditions import Change, CycleStates, Effect
from tis.common.scenario.network.loss import TraceLoss
from tis.common.scenario.network.pipeline import Pipeline
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
_BY_NAME: Final = ("duplicate", "corrupt", "reorder")
_BIT_RATES: Final = ((1e6, "Gbit/s"), (1e3, "Mbit/s"))


class DirectionFigures(NamedTuple):
    """Long-run figures of one direction, without ordering, queues, stalls and timeline; delays of arriving messages.

    ``loss_pct`` is the share of messages offered outside outages, ``outage_pct`` and ``stall_pct`` are the shares of
    time in an outage and in a stall.
    ``recovered_pct`` is the share of messages whose first sending is lost and repeated; how late they are, and what
    waits behind them, depends on the message rate (`tis.netem.expected.simulate`).
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


class _Regime(NamedTuple):
    """The models that apply for a share of the time."""

    share: float
    latency: LatencyModel
    scale: float
    add_ms: float
    p_loss: float
    mean_burst: float | None
    p_recovered: float


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
    recovered = sum(regime.share * regime.p_recovered for regime in up) / total
    return DirectionFigures(*_delays(arriving), 100 * loss, burst, 100 * outage, 100 * stall, 100 * recovered)


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
        p_recovered = 0.0
        if stages.recovery is not None:
            p_recovered, p_loss, burst = p_loss, 0.0, 0.0
        levels = levels_ms(network.steps, direction)
        added_ms, of_each = (change.add_delay_ms + levels).tolist(), share / len(levels)
        up += [_Regime(of_each, latency, change.scale_delay, ms, p_loss, burst, p_recovered) for ms in added_ms]
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


def direction_label(direction: Direction) -> str:
    """Return a direction with its networks, as ``forward (west to east)``."""
    return f"{direction} ({ORIGIN[direction]} to {DESTINATION[direction]})"


def synopsis(network: NetworkPart, traces: Mapping[str, Trace]) -> list[str]:
    """Return one line per direction: its long-run figures, as in the profile library, and its changes.

    Oracle: the library's own figures and literal lines, tests/netem/expected/test_synopsis.
    """
    return [
        f"{direction_label(direction)}: {_words(network, direction, traces)}" for direction in get_args(Direction)
    ]


def _words(network: NetworkPart, direction: Direction, traces: Mapping[str, Trace]) -> str:
    of = direction_figures(network, direction, traces)
    changes = () if network.states is None else [getattr(state, direction) for state in network.states.states]
    pipeline = getattr(network, direction)
    words = []
    if isnan(of.mean_ms):
        words.append("nothing arrives")
    elif pipeline.delay is not None or of.mean_ms > 0:
        as_drawn = " as drawn" if of.std_ms > 0 else ""  # in order, a late one holds back those behind it
        words.append(f"delay {of.mean_ms:.4g} ms, sd {of.std_ms:.3g}{as_drawn}")
    if of.loss_pct > 0:
        words.append(f"loss {of.loss_pct:.3g} %{_of_each(pipeline, changes)}{_in_a_row(of, pipeline, changes)}")
    if of.recovered_pct > 0:
        words.append(f"{of.recovered_pct:.3g} %{_of_each(pipeline, changes)} sent again (recovery)")
    if of.outage_pct > 0:
        words.append(f"outages {of.outage_pct:.3g} % of the time")
    if of.stall_pct > 0:
        words.append(f"stalls {of.stall_pct:.3g} % of the time")
    words += [name for name in _BY_NAME if any(getattr(part, name) is not None for part in (pipeline, *changes))]
    words += _rates(pipeline, changes)
    words += [f"steps every {of.every_s:g} s" for of in network.steps if of.direction in (direction, "both")]
    words += [*_states(network), *_timeline(network, direction), *_rules(network, direction)]
    return ", ".join(words) or "nothing injected"


def _in_a_row(of: DirectionFigures, pipeline: Pipeline, changes: Sequence[Change]) -> str:
    """Return the mean length of a burst where losses are not independent and it is known."""
    has_bursts = any(part.loss is not None and part.loss.kind != "bernoulli" for part in (pipeline, *changes))
    is_known = has_bursts and of.mean_burst is not None and isfinite(of.mean_burst)
    return f" in bursts of {of.mean_burst:.3g} on average" if is_known else ""


def _of_each(pipeline: Pipeline, changes: Sequence[Change]) -> str:
    """Return the unit of the loss if it is a packet: a message of several packets is lost more often."""
    losses = [part.loss for part in (pipeline, *changes)]
    sizes = {loss.mtu_bytes: None for loss in losses if not isinstance(loss, TraceLoss | None)}
    if not any(sizes):
        return ""
    named = " or ".join("whole message" if size is None else f"packet of {size} bytes" for size in sizes)
    return f" of each {named}"


def _rates(pipeline: Pipeline, changes: Sequence[Change]) -> list[str]:
    """Return the bit rates of the pipeline and of the states, each with the bounds of its queue."""
    rates = [part.rate for part in (pipeline, *changes) if part.rate is not None]
    texts = dict.fromkeys(_rate_in_words(rate) for rate in rates)
    return [" or ".join(texts)] if texts else []


def _rate_in_words(rate: Capacity | str) -> str:
    if isinstance(rate, str):
        return "the link's rate"
    queue = rate.queue
    bounds = [f"{queue.max_packets} messages"] if queue.max_packets < MAX_COUNT else []
    bounds += [] if queue.max_bytes is None else [f"{queue.max_bytes} bytes"]
    kind = f"{_queue_kind(queue)}, target {queue.target_ms:g} ms," if isinstance(queue, CoDel) else _queue_kind(queue)
    of = f" of {' or '.join(bounds)}" if bounds else " without a bound"
    overhead = f", {rate.overhead_bytes} bytes on top of each" if rate.overhead_bytes else ""
    full = ", senders wait while it is full" if rate.backpressure else ""
    return f"rate {_capacity(rate)} ({kind}{of}{overhead}{_cross_in_words(rate.cross)}{full})"


def beside_delay(pipeline: Pipeline) -> list[str]:
    """Return in words the stages of a pipeline beside delay, jitter and loss, as the queue of its rate."""
    rate = pipeline.rate
    found = [name for name in _BY_NAME if getattr(pipeline, name) is not None]
    if isinstance(rate, str):
        found.append("the link's queue")
    elif rate is not None:
        found.append(f"a {_queue_kind(rate.queue)} at {_capacity(rate)}{_cross_in_words(rate.cross)}")
    return found


def _queue_kind(queue: Queue) -> str:
    return {"codel": "CoDel queue", "priority": "priority queue"}.get(queue.kind, "queue")


def _capacity(rate: Capacity) -> str:
    return f"opportunities of {rate.opportunities}" if isinstance(rate, RecordedRate) else _bit_rate(rate.kbit_s)


def _cross_in_words(cross: Cross | None) -> str:
    if cross is None:
        return ""
    return f", shared with {_bit_rate(cross.kbit_s)} of others, {cross.kind.replace('_', ' and ')}"


def _bit_rate(kbit_s: float) -> str:
    scale, unit = next(((scale, unit) for scale, unit in _BIT_RATES if kbit_s >= scale), (1.0, "kbit/s"))
    return f"{kbit_s / scale:.6g} {unit}"


def _states(network: NetworkPart) -> list[str]:
    states = network.states
    if states is None:
        return []
    names = "/".join(dict.fromkeys(state.name for state in states.states))
    if isinstance(states, CycleStates):
        return [f"states {names} in a cycle of {sum(state.for_s for state in states.states):g} s"]
    return [f"states {names}"]


def _timeline(network: NetworkPart, direction: Direction) -> list[str]:
    n = sum(entry.direction in (direction, "both") for entry in network.timeline)
    return [f"timeline of {n}"] if n else []


def _rules(network: NetworkPart, direction: Direction) -> list[str]:
    n = sum(rule.direction in (direction, "both") for rule in network.rules)
    return [f"{n} rule{'s' if n > 1 else ''}"] if n else []
