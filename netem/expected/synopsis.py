"""The line of each direction that states a network's requested figures, printed before the first message passes."""

from collections.abc import Mapping, Sequence
from math import isfinite, isnan
from typing import Final, get_args

from tis.common.channels import DESTINATION, ORIGIN, Direction
from tis.common.scenario.network import NetworkPart
from tis.common.scenario.network.capacity import MAX_COUNT, Capacity, CoDel, Cross, Queue, RecordedRate
from tis.common.scenario.network.conditions import Change, CycleStates
from tis.common.scenario.network.loss import TraceLoss
from tis.common.scenario.network.pipeline import Pipeline
from tis.common.trace import Trace
from tis.netem.expected.figures import DirectionFigures, direction_figures

_SHARES: Final = {"duplicate": "p_duplicate", "corrupt": "p_corrupt", "reorder": "p_reorder"}
_ORDERINGS: Final = {
    "reorder": "messages overtake (ordering reorder)",
    "drop_late": "overtaken ones dropped (ordering drop_late)",
}
_BIT_RATES: Final = ((1e6, "Gbit/s"), (1e3, "Mbit/s"))


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
        words.append(f"loss {_lost(of, of.loss_pct, pipeline, changes)}{_in_a_row(of, pipeline, changes)}")
    if of.recovered_pct > 0:
        words.append(f"{_lost(of, of.recovered_pct, pipeline, changes)} sent again (recovery)")
    if of.outage_pct > 0:
        words.append(f"outages {of.outage_pct:.3g} % of the time")
    if of.stall_pct > 0:
        words.append(f"stalls {of.stall_pct:.3g} % of the time")
    words += _shares((pipeline, *changes))
    words += _rates(pipeline, changes)
    words += [f"steps every {of.every_s:g} s" for of in network.steps if of.direction in (direction, "both")]
    words += [*_states(network), *_timeline(network, direction), *_rules(network, direction)]
    return ", ".join(words) or "nothing injected"


def _in_a_row(of: DirectionFigures, pipeline: Pipeline, changes: Sequence[Change]) -> str:
    """Return the mean length of a burst where losses are not independent and it is known."""
    has_bursts = any(part.loss is not None and part.loss.kind != "bernoulli" for part in (pipeline, *changes))
    is_known = has_bursts and of.mean_burst is not None and isfinite(of.mean_burst)
    return f" in bursts of {of.mean_burst:.3g} on average" if is_known else ""


def _lost(of: DirectionFigures, both_pct: float, pipeline: Pipeline, changes: Sequence[Change]) -> str:
    """Return the shares that are lost: one, or two where the stage's is of packets and states add one of messages."""
    unit = _of_each(pipeline, changes)
    if not unit or not of.added_loss_pct:
        return f"{both_pct:.3g} %{unit}"
    return f"{of.own_loss_pct:.3g} %{unit}, and by states {of.added_loss_pct:.3g} % of each whole message"


def _of_each(pipeline: Pipeline, changes: Sequence[Change]) -> str:
    """Return the unit of the loss if it is a packet: a message of several packets is lost more often."""
    losses = [part.loss for part in (pipeline, *changes)]
    sizes = {loss.mtu_bytes: None for loss in losses if not isinstance(loss, TraceLoss | None)}
    if not any(sizes):
        return ""
    named = " or ".join("whole message" if size is None else f"packet of {size} bytes" for size in sizes)
    return f" of each {named}"


def _shares(parts: Sequence[Pipeline | Change]) -> list[str]:
    """Return the shares of messages that the stages beside loss concern, and an ordering other than fifo."""
    found = []
    for name, p in _SHARES.items():
        shares = dict.fromkeys(getattr(stage, p) for part in parts if (stage := getattr(part, name)) is not None)
        found += [f"{name} {' or '.join(f'{100 * share:.3g}' for share in shares)} %"] if shares else []
    return found + [
        _ORDERINGS[part.ordering] for part in parts if isinstance(part, Pipeline) and part.ordering != "fifo"
    ]


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
    found = _shares((pipeline,))
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
