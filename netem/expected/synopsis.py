"""A one-line description of each direction of a network, printed before the first message passes."""

from collections.abc import Mapping, Sequence
from math import isnan
from typing import Final, get_args

from tis.common.channels import DESTINATION, ORIGIN, Direction
from tis.common.scenario.network import NetworkPart
from tis.common.scenario.network.capacity import Capacity, CoDel, Cross, RecordedRate
from tis.common.scenario.network.conditions import Change, CycleStates
from tis.common.scenario.network.loss import TraceLoss
from tis.common.scenario.network.pipeline import Pipeline
from tis.common.trace import Trace
from tis.netem.expected.figures import direction_figures

_BY_NAME: Final = ("duplicate", "corrupt", "reorder")
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
        words.append(f"delay {of.mean_ms:.4g} ms, sd {of.std_ms:.3g}")
    if of.loss_pct > 0:
        words.append(f"loss {of.loss_pct:.3g} %{_of_each(pipeline, changes)}")
    if of.outage_pct > 0:
        words.append(f"outages {of.outage_pct:.3g} % of the time")
    if of.stall_pct > 0:
        words.append(f"stalls {of.stall_pct:.3g} % of the time")
    words += [name for name in _BY_NAME if any(getattr(part, name) is not None for part in (pipeline, *changes))]
    words += _rates(pipeline, changes)
    words += [*_states(network), *_timeline(network, direction), *_rules(network, direction)]
    return ", ".join(words) or "nothing injected"


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
    bounds = [f"{queue.max_packets} messages"]
    bounds += [] if queue.max_bytes is None else [f"{queue.max_bytes} bytes"]
    kind = f"CoDel queue, target {queue.target_ms:g} ms," if isinstance(queue, CoDel) else "queue"
    overhead = f", {rate.overhead_bytes} bytes on top of each" if rate.overhead_bytes else ""
    what = f"opportunities of {rate.opportunities}" if isinstance(rate, RecordedRate) else _bit_rate(rate.kbit_s)
    return f"rate {what} ({kind} of {' or '.join(bounds)}{overhead}{_cross_in_words(rate.cross)})"


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
