"""Netem's control under fire: requests as the Zenoh callbacks take them, while both links decide packets."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import TracebackType
from typing import Any, Final, Self, TypeVar, cast

import zenoh

from tests.fuzz.control_requests import TRACES, WAYS, a_network, a_request
from tests.fuzz.episode import Episode, Log
from tests.fuzz.hostile import odd_header
from tis.common.channels import Direction, Network, keys_of
from tis.common.messages import Header, decode, encode
from tis.common.node import Record
from tis.common.records import CONTROL, ControlNote
from tis.common.scenario.control import EVERY_STATE, control_prefix
from tis.common.scenario.network import NetworkPart
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.netem.bridge.control import BridgeControl
from tis.netem.build import build_links
from tis.netem.control.replay import changed_conditions
from tis.netem.link.link import Link

T = TypeVar("T")

_PREFIX: Final = control_prefix("tis")
_LIBRARY: Final[dict[str, Any]] = {"good": {"forward": {"duplicate": {"p_duplicate": 1}}}, "bad": {"outages": 3}}


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
    raw = a_network(rng)
    network = NetworkPart.model_validate(raw)
    links = build_links(network, ["tis/**"], rng.randrange(9), TRACES, "fuzz")
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
                    log.keep(record)
                bridge.records.clear()
                yield
            _packets(episode, links, bridge.now_ns, seq, log)
            yield
        episode.n_used += sum(link.released for link in links.values())
        for link in links.values():
            for record in link.ledger.close(bridge.now_ns)():
                log.keep(record)
        # the changes repeated in virtual time
        if rng.random() < 0.5:
            kept = [decode(encode(note), ControlNote) for note in notes]
            assert all(record.topic == CONTROL for record in bridge.records)
            for way in WAYS:
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
                log.keep(record)


def _ask(episode: Episode, control: BridgeControl, bridge: FakeBridge) -> None:
    """Let control take a request or a query, and answer it as its thread does."""
    rng = episode.rng
    operation, payload = a_request(rng, (bridge.now_ns or 0) / NS_PER_S)
    key = rng.choice((f"{_PREFIX}{operation}",) * 8 + (EVERY_STATE, f"{_PREFIX}*", f"{_PREFIX}a/b", operation))
    query = FakeQuery(key) if rng.random() < 0.7 else None
    episode.given(key, payload)
    network: Network = rng.choice(("west", "east"))
    control._take(network, key, zenoh.ZBytes(payload) if payload or rng.random() < 0.5 else None, cast("Any", query))
    while not control._waiting.empty():
        control._answer(control._waiting.get_nowait())
