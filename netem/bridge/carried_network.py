"""The network of what is carried unread: what needs keys is refused, and of a stream what needs messages, too.

An outage holds a stream up, not off.
"""

from collections.abc import Iterator, Mapping
from typing import Any, Final, get_args

from tis.common.channels import Direction
from tis.common.errors import Fault, InputError
from tis.common.scenario.network import Buffer, NetworkPart
from tis.common.scenario.network.capacity import MAX_COUNT, CoDel, PriorityQueue, Rate, RecordedRate, TailDrop
from tis.common.scenario.network.conditions import BothOr, Change, State
from tis.common.scenario.network.pipeline import Stages

_RULE: Final = "needs messages: a stream of bytes (--carry tcp) loses, copies, alters and reorders nothing"
_LOSS_RULE: Final = "needs recovery, as a stream of bytes (--carry tcp) repeats what it loses: {..., recovery: {}}"
_CLEAN_RULE: Final = "would end the recovery, without which a stream of bytes (--carry tcp) may lose nothing"
_MESSAGES: Final = ("duplicate", "corrupt", "reorder")
_WAYS: Final[tuple[Direction, ...]] = get_args(Direction)
_DEFAULT_BYTES: Final = 4_000_000
_PACKET_BYTES: Final = 1500
_UNBOUNDED: Final = TailDrop(kind="tail_drop", max_packets=MAX_COUNT, max_bytes=None)
_ROOMY: Final = Buffer(max_packets=10_000_000, max_mb=1_000_000)


def stream_network(network: NetworkPart, where: str) -> NetworkPart:
    """Return the network as it acts on bytes; raises `InputError` with every part that needs messages.

    An outage becomes a stall: TCP repeats what it loses, so nothing arrives until the outage ends; where a recovery
    always holds, its repeats do that. Nothing may be dropped, so queues have no bound; `backlog_bytes` holds the
    sender back instead.
    """
    repeats = _repeating(network)
    faults = _rules_faults(network, where, "a stream of bytes (--carry tcp)")
    changed: dict[str, Any] = {"buffer": _ROOMY, "unmatched": "refuse"}
    for direction in _WAYS:
        pipeline = getattr(network, direction)
        faults += _faults(where, direction, pipeline, True)
        changed[direction] = pipeline.model_copy(update=_unbounded(pipeline))
    for field, ways, change in _changes(network):
        faults += _faults(where, field, change, repeats.issuperset(ways))
    if faults:
        raise InputError(faults)
    changed["outages"] = tuple(
        part if repeats.issuperset(_ways(part.direction)) else part.model_copy(update={"effect": "stall"})
        for part in network.outages
    )
    changed["timeline"] = tuple(
        entry.model_copy(update={"set": _on_bytes(entry.set, repeats.issuperset(_ways(entry.direction)))})
        for entry in network.timeline
    )
    if network.states is not None:
        states = tuple(_state(state, repeats) for state in network.states.states)
        changed["states"] = network.states.model_copy(update={"states": states})
    return network.model_copy(update=changed)


def datagram_network(network: NetworkPart, where: str) -> NetworkPart:
    """Return the network as it acts on datagrams; raises `InputError` with every part that needs Zenoh's messages."""
    faults = _rules_faults(network, where, "datagrams (--carry udp)")
    for direction in _WAYS:
        faults += _zenoh_faults(where, direction, getattr(network, direction))
    for field, _, change in _changes(network):
        faults += _zenoh_faults(where, field, change)
    if faults:
        raise InputError(faults)
    return network


def datagram_change(network: NetworkPart, change: Change) -> Change:  # noqa: ARG001  (a stream needs it)
    """Return a change that was asked for live, as it acts on datagrams; raises `InputError`."""
    faults = _zenoh_faults("control", "change", change)
    if faults:
        raise InputError(faults)
    return change


def stream_change(network: NetworkPart, change: Change) -> Change:
    """Return a change that was asked for live of a stream's network, as it acts on bytes; raises `InputError`."""
    repeating = _repeating(network)
    repeats = repeating.issuperset(_WAYS)
    faults = _faults("control", "change", change, repeats)
    if repeating and change.clean:
        faults.append(Fault("control", "change.clean", _CLEAN_RULE))
    if faults:
        raise InputError(faults)
    return _on_bytes(change, repeats)


def backlog_bytes(network: NetworkPart) -> Mapping[Direction, int]:
    """Return how many bytes each direction takes from senders before it makes them wait.

    These are the bounds of the direction's queue, as far as it has one.
    """
    return {direction: _bound(getattr(network, direction).rate) for direction in _WAYS}


def needs_segments(network: NetworkPart) -> bool:
    """Tell whether a rate or a loss acts at some time, so that bytes have to be sent in segments."""
    stages = (network.forward, network.feedback, *(change for _, _, change in _changes(network)))
    return any(one.rate is not None or one.loss is not None or getattr(one, "add_p_loss", 0.0) for one in stages)


def _bound(rate: Rate | RecordedRate | str | None) -> int:
    if not isinstance(rate, Rate | RecordedRate):
        return _DEFAULT_BYTES
    of_packets = rate.queue.max_packets * _PACKET_BYTES
    return max(_PACKET_BYTES, of_packets if rate.queue.max_bytes is None else min(of_packets, rate.queue.max_bytes))


def _repeating(network: NetworkPart) -> frozenset[Direction]:
    """Return the directions in which a recovery holds all the time, so that what is lost is repeated."""
    clean = {way for _, ways, change in _changes(network) if change.clean for way in ways}
    return frozenset(way for way in _WAYS if getattr(network, way).recovery is not None and way not in clean)


def _ways(direction: BothOr) -> tuple[Direction, ...]:
    return _WAYS if direction == "both" else (direction,)


def _changes(network: NetworkPart) -> Iterator[tuple[str, tuple[Direction, ...], Change]]:
    for i, entry in enumerate(network.timeline):
        yield f"timeline.{i}.set", _ways(entry.direction), entry.set
    for i, state in enumerate(() if network.states is None else network.states.states):
        for way in _WAYS:
            yield f"states.states.{i}.{way}", (way,), getattr(state, way)


def _rules_faults(network: NetworkPart, where: str, among: str) -> list[Fault]:
    return [Fault(where, "rules", f"need keys, and there are none in {among}")] if network.rules else []


def _zenoh_faults(where: str, field: str, stages: Stages) -> list[Fault]:
    if not isinstance(stages.rate, Rate | RecordedRate):
        return []
    faults = []
    if isinstance(stages.rate.queue, PriorityQueue):
        faults.append(Fault(where, f"{field}.rate.queue", "needs priorities, which datagrams (--carry udp) lack"))
    if stages.rate.backpressure:
        rule = "needs senders that can be held back, unlike those of datagrams (--carry udp)"
        faults.append(Fault(where, f"{field}.rate.backpressure", rule))
    return faults


def _faults(where: str, field: str, stages: Stages, repeats: bool) -> list[Fault]:
    """Return what a stream cannot have; ``repeats``: a recovery always holds beside ``stages``."""
    names = [name for name in _MESSAGES if getattr(stages, name) is not None]
    if getattr(stages, "ordering", None) not in (None, "fifo"):
        names.append("ordering")
    if isinstance(stages.rate, Rate | RecordedRate) and isinstance(stages.rate.queue, CoDel | PriorityQueue):
        names.append("rate.queue")
    losses = ["loss"] if stages.loss is not None and stages.recovery is None else []
    if getattr(stages, "add_p_loss", 0.0) > 0.0 and not repeats:
        losses.append("add_p_loss")
    rules = dict.fromkeys(losses, _LOSS_RULE) | dict.fromkeys(names, _RULE)
    return [Fault(where, f"{field}.{name}", rule) for name, rule in rules.items()]


def _unbounded(stages: Stages) -> dict[str, Any]:
    rate = stages.rate
    return {"rate": rate.model_copy(update={"queue": _UNBOUNDED})} if isinstance(rate, Rate | RecordedRate) else {}


def _on_bytes(change: Change, repeats: bool) -> Change:
    update = _unbounded(change)
    if change.outage and not repeats:
        update |= {"outage": False, "stall": True}
    return change.model_copy(update=update) if update else change


def _state(state: State, repeats: frozenset[Direction]) -> State:
    return state.model_copy(update={way: _on_bytes(getattr(state, way), way in repeats) for way in _WAYS})
