"""Netem's control under fire: requests as the Zenoh callbacks take them, while both links decide packets."""

import json
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import TracebackType
from typing import Any, Final, Self, TypeVar, cast, get_args

import zenoh

from common.channels import Direction, Network, keys_of
from common.header import Header
from common.node import Record
from common.records import CONTROL, ControlNote
from common.scenario.control import ACKNOWLEDGED, EVERY_STATE, SCHEMA, STATE, control_prefix
from common.scenario.network import NetworkPart
from common.units import NS_PER_MS, NS_PER_S
from netem.bridge.control import BridgeControl
from netem.build import build_links
from netem.control.changed_conditions import changed_conditions
from netem.link.link import Link
from tests.fuzz.episode import Episode, Log
from tests.fuzz.hostile import OTHERS, Raw, an_extreme, bytes_of, damaged, odd_fields, odd_header, places, put

T = TypeVar("T")

_PREFIX: Final = control_prefix("tis")
_WAYS: Final[tuple[Direction, ...]] = get_args(Direction)
_BORDERS_TEXT: Final = (
    "0 -0.0 5e-324 1e-300 1e-17 1e-12 1e-9 1e-6 0.0005 0.001 0.0010000001 0.05 0.5 0.9999999999999999 1 "
    "1.0000000000000002 2 16 63 64 999 1000 1000.0001 1500 2000 60000 65535 86400 600000 1000000 3600000 3600000.1 "
    "31536000 86400000 1e7 1e9 1000000000 1e300"
)
_BORDERS: Final = [*map(Raw, _BORDERS_TEXT.split())]
"""Numbers at which the models of requests end."""
_DELAYS: Final[list[dict[str, Any]]] = [
    {"kind": "constant", "delay_ms": 3},
    {"kind": "uniform", "low_ms": 1, "high_ms": 9},
    {"kind": "normal", "mean_ms": 20, "std_ms": 5},
    {"kind": "lognormal", "shift_ms": 1, "max_ms": 900, "mean_ms": 20, "std_ms": 5},
    {"kind": "gamma", "shift_ms": 1, "max_ms": 900, "mean_ms": 20, "std_ms": 5},
    {"kind": "pareto", "shift_ms": 1, "max_ms": 900, "scale_ms": 20, "shape": 2.5},
    {"kind": "hyperexponential", "weights": [0.5, 0.5], "means_ms": [1, 30]},
    {"kind": "quantiles", "points": [{"p": 0, "delay_ms": 1}, {"p": 0.5, "delay_ms": 2}, {"p": 1, "delay_ms": 9}]},
    {"kind": "trace", "path": "a.csv"},
]
_LOSSES: Final[list[dict[str, Any]]] = [
    {"kind": "bernoulli", "p_loss": 0.1, "mtu_bytes": 64},
    {"kind": "burst", "p_loss": 0.1, "mean_burst": 3},
    {"kind": "gilbert_elliott", "p_bad": 0.1, "p_good": 0.5, "p_loss_bad": 0.9, "p_loss_good": 0.01},
    {"kind": "four_state", "p13": 0.1, "p31": 0.5, "p32": 0.1, "p23": 0.9, "p14": 0.05},
    {"kind": "pareto_runs", "received": {"shape": 1.5, "scale": 20}, "lost": {"shape": 1.5, "scale": 2}},
    {
        "kind": "gilbert_pareto", "p_bad": 0.1, "p_good": 0.5, "good": {"shape": 2, "scale": 1},
        "bad": {"shape": 2, "scale": 5},
    },
]  # fmt: skip
_CROSSES: Final[list[dict[str, Any]]] = [
    {"kind": "constant", "kbit_s": 100, "message_bytes": 500},
    {"kind": "on_off", "kbit_s": 100, "message_bytes": 500, "mean_on_s": 0.1, "mean_off_s": 0.2},
    {"kind": "poisson", "kbit_s": 100, "message_bytes": 500},
]
_QUEUES: Final[list[dict[str, Any]]] = [
    {"kind": "tail_drop", "max_packets": 10, "max_bytes": 5000},
    {"kind": "codel", "target_ms": 5, "interval_ms": 100, "max_packets": 10},
]
_STAGES: Final[Mapping[str, Callable[[random.Random], Any]]] = {
    "delay": lambda rng: rng.choice(_DELAYS),
    "loss": lambda rng: rng.choice(_LOSSES),
    "duplicate": lambda _: {"p_duplicate": 0.3},
    "corrupt": lambda _: {"p_corrupt": 0.5, "bits": 3},
    "rate": lambda rng: rng.choice(
        (
            "link",
            {"kbit_s": 500, "overhead_bytes": 40, "queue": rng.choice(_QUEUES), "cross": rng.choice(_CROSSES)},
            {"kbit_s": 50},
        )
    ),
    "jitter": lambda rng: rng.choice(({"kind": "normal", "std_ms": 2}, {"kind": "uniform", "half_width_ms": 2})),
    "correlation": lambda rng: {"half_life_s": 0.5, "across_keys": rng.random() < 0.5, "shared": 0.5},
    "reorder": lambda _: {"p_reorder": 0.2, "early_ms": 3},
    "ordering": lambda rng: rng.choice(("fifo", "reorder", "drop_late")),
    "outage": lambda _: True,
    "stall": lambda _: True,
    "clean": lambda _: True,
    "scale_rate": lambda _: 2.0,
    "scale_delay": lambda _: 2.0,
    "add_delay_ms": lambda _: 5.0,
    "add_p_loss": lambda _: 0.1,
}
_LIBRARY: Final[dict[str, Any]] = {"good": {"forward": {"delay": _DELAYS[0]}}, "bad": {"outages": 3}}


class FakeBridge:
    """What control sees of the running emulator."""

    def __init__(self, links: dict[Direction, Link]) -> None:
        self.links = links
        self.now_ns: int | None = None
        self.records: list[Record] = []

    def intervene(self, act: Callable[[int], tuple[T, Sequence[Record]]]) -> T | None:
        if self.now_ns is None:
            return None
        answer, records = act(self.now_ns)
        self.records.extend(records)
        return answer

    def counters(self) -> dict[str, int]:
        return {name: n for link in self.links.values() for name, n in link.counters().items()}

    def failed(self, error: BaseException) -> None:
        raise error


class FakeQuery:
    """A query of Zenoh, which keeps its reply."""

    def __init__(self, key: str) -> None:
        self.key_expr = key
        self.replies: list[str] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        pass

    def drop(self) -> None:
        pass

    def reply(self, key: str, text: str, **_: Any) -> None:
        json.loads(text)
        self.replies.append(text)


class FakeSession:
    """A session of Zenoh, which keeps the acknowledgements."""

    def __init__(self) -> None:
        self.puts: list[str] = []

    def put(self, key: str, text: str, **_: Any) -> None:
        json.loads(text)
        self.puts.append(text)


def _library(name: str) -> Mapping[str, Any]:
    if name not in _LIBRARY:
        raise LookupError("must be a profile of the library")
    return cast("Mapping[str, Any]", _LIBRARY[name])


def control_episode(episode: Episode, quick: bool = False) -> Iterator[None]:
    """Run an emulator with its control for some seconds of run time, step by step."""
    rng = episode.rng
    raw = _network(rng)
    network = NetworkPart.model_validate(raw)
    links = build_links(network, ["tis/**"], rng.randrange(9), None, "fuzz")
    bridge, sessions = FakeBridge(links), {"west": FakeSession(), "east": FakeSession()}
    control = BridgeControl(cast("Any", bridge), cast("Any", sessions), "tis", _library)
    notes: list[ControlNote] = []
    yield
    with Log("netem") as log:
        _ask(episode, control, bridge)
        bridge.now_ns = 0
        for seq in range(rng.choice((40, 150))):
            bridge.now_ns += rng.choice((0, 1, NS_PER_MS, 7 * NS_PER_MS, 33 * NS_PER_MS, rng.randrange(2 * NS_PER_S)))
            if rng.random() < 0.3:
                _ask(episode, control, bridge)
                for record in bridge.records:
                    notes += [record.data] if isinstance(record.data, ControlNote) else []
                    log.log.record(record)
                bridge.records.clear()
                yield
            _packets(episode, links, bridge.now_ns, seq, log)
            yield
        episode.n_used += sum(link.released for link in links.values())
        for link in links.values():
            for record in link.ledger.close(bridge.now_ns)():
                log.log.record(record)
        # the changes repeated in virtual time
        if rng.random() < 0.5:
            kept = [ControlNote.model_validate_json(note.model_dump_json()) for note in notes]
            assert all(record.topic == CONTROL for record in bridge.records)
            for way in _WAYS:
                changed_conditions(network, way, 3, kept).at(bridge.now_ns)
            yield
        if rng.random() < 0.3:
            log.read_back()
            yield


def _packets(episode: Episode, links: dict[Direction, Link], now_ns: int, seq: int, log: Log) -> None:
    """Offer a packet in either direction, some with odd headers, and release what is due."""
    rng = episode.rng
    for way, link in links.items():
        while (due_ns := link.next_release_ns()) is not None and due_ns <= now_ns:
            for due in link.release(due_ns):
                if due.departure == "released":
                    link.payload(due, due.item)
                link.left(due, due_ns)
        key = rng.choice((*keys_of(way, "tis"), "tis/other", "other"))
        payload = b"x" * rng.choice((0, 1, 60, 300, 300, 300, 70_000))
        header = Header(seq, now_ns)
        attachment = odd_header(header, rng) if rng.random() < 0.1 else header.pack()
        episode.n_messages += 1
        if link.lets_through(key, len(payload) + len(attachment), now_ns):
            link.crossed(key, attachment, len(payload), now_ns, now_ns)
        else:
            link.offer(key, attachment, len(payload), now_ns, payload)
            link.note_queue_depth(now_ns)
        if link.ledger.is_full(now_ns):
            for record in link.ledger.close(now_ns)():
                log.log.record(record)


def _ask(episode: Episode, control: BridgeControl, bridge: FakeBridge) -> None:
    """Let control take a request or a query, and answer it as its thread does."""
    rng = episode.rng
    operation, payload = _request(rng, (bridge.now_ns or 0) / NS_PER_S)
    key = rng.choice((f"{_PREFIX}{operation}",) * 8 + (EVERY_STATE, f"{_PREFIX}*", f"{_PREFIX}a/b", operation))
    query = FakeQuery(key) if rng.random() < 0.7 else None
    episode.given(key, payload)
    network: Network = rng.choice(("west", "east"))
    control._take(network, key, zenoh.ZBytes(payload) if payload or rng.random() < 0.5 else None, cast("Any", query))
    while not control._waiting.empty():
        control._answer(control._waiting.get_nowait())


def _request(rng: random.Random, now_s: float) -> tuple[str, bytes]:
    operation = rng.choice(("set",) * 8 + ("outage", "profile", "reset", STATE, SCHEMA, ACKNOWLEDGED, "x" * 200, ""))
    value: Any
    match operation:
        case "set":
            value = [_a_set(rng, now_s) for _ in range(rng.choice((1, 2, 3, 33)))]
            value = value[0] if len(value) == 1 and rng.random() < 0.9 else value
        case "outage":
            value = {"direction": "both", "for_ms": 50, "effect": rng.choice(("loss", "stall"))}
        case "profile":
            value = {"profile": rng.choice(("good", "bad", "none"))}
            if rng.random() < 0.7:
                value["network"] = {way: _pipeline(rng) for way in _WAYS}
        case _:
            value = {"id": "a"}
    if rng.random() < 0.6:
        value = _with_borders(value, rng)
    elif rng.random() < 0.2 and isinstance(value, dict):
        value = odd_fields(value, rng)
    payload = bytes_of(value)
    return operation, damaged(payload, rng) if rng.random() < 0.1 else payload


def _a_set(rng: random.Random, now_s: float) -> dict[str, Any]:
    names = rng.sample(list(_STAGES), rng.randint(1, 4))
    found: dict[str, Any] = {
        "direction": rng.choice((*_WAYS, "both")),
        "change": {name: _STAGES[name](rng) for name in names},
    }
    if rng.random() < 0.3:
        found["at_s"] = now_s + rng.choice((0.001, 0.5, 3))
    if rng.random() < 0.5:
        found["for_s"] = rng.choice((0.001, 0.5, 5))
        if rng.random() < 0.5:
            found["ramp_s"] = found["for_s"] / rng.choice((2, 3, 1e9))
    return found


def _with_borders(value: Any, rng: random.Random) -> Any:
    """Return a request with one to three leaves at the ends of what its model admits, or beyond."""
    found = json.loads(json.dumps(value))
    paths = places(found)
    for _ in range(rng.choice((1, 1, 2, 3)) if paths else 0):
        chosen = rng.random()
        new = rng.choice(_BORDERS) if chosen < 0.8 else an_extreme(rng) if chosen < 0.95 else rng.choice(OTHERS)
        put(found, rng.choice(paths), new)
    return found


def _pipeline(rng: random.Random) -> dict[str, Any]:
    names = ("delay", "loss", "duplicate", "corrupt", "rate", "jitter", "correlation")
    found = {name: _STAGES[name](rng) for name in rng.sample(names, rng.randint(0, 3))}
    if found.get("delay", {}).get("kind") == "trace":
        del found["delay"]
    if "delay" not in found:
        found.pop("jitter", None)
        found.pop("correlation", None)
    if found.get("rate") == "link":
        del found["rate"]
    return found


def _network(rng: random.Random) -> dict[str, Any]:
    found: dict[str, Any] = {way: _pipeline(rng) for way in _WAYS}
    if rng.random() < 0.3:
        found["outages"] = [{"kind": "periodic", "every_s": 2, "for_s": 0.5, "effect": rng.choice(("loss", "stall"))}]
    if rng.random() < 0.3:
        found["rules"] = [{"key": "tis/MTML/**", "direction": "forward", "pipeline": _pipeline(rng)}]
    if rng.random() < 0.3:
        found["buffer"] = {"max_packets": 20, "policy": rng.choice(("drop_oldest", "drop_newest"))}
    return found
