"""What applications do with Zenoh, and what comes of it: told in counts, keys and contents, never in times.

Each scenario has keys of its own, so that all can run at once in one network.
"""

import json
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Collection
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

import zenoh
from zenoh import ext

from tests.common.runtime.live_zenoh import a_client, settle, soon
from tis.common.runtime.zenoh_session import ZenohOptions, configure

_SPREAD_S = 1.5
"""Longer than a declaration needs to become known on the other side, at 50 ms of delay too."""
_ARRIVAL_S = 1.5
_TIME_OUT_S = 4.0


@dataclass
class Between:
    """A network with a client on each side; further ones join at the endpoints."""

    west: zenoh.Session
    east: zenoh.Session
    west_end: str
    east_end: str


Scenario = Callable[[Between, str], Any]
SCENARIOS: dict[str, Scenario] = {}


def _scenario(told: Scenario) -> Scenario:
    SCENARIOS[told.__name__.strip("_")] = told
    return told


def _stamp(after_s: float) -> zenoh.Timestamp:
    """Return a timestamp, made as older versions of Zenoh can, too."""
    return zenoh.Timestamp(datetime.fromtimestamp(1_700_000_000 + after_s, UTC), b"abc")


def _known(*sessions: zenoh.Session) -> None:
    settle(*sessions)
    time.sleep(_SPREAD_S)


def _heard(there: Between, key: str, act: Callable[[], None], read: Callable[[zenoh.Sample], Any]) -> list[Any]:
    """Return what a subscriber in the east reads off the samples that ``act`` brings about, in their order."""
    found: list[Any] = []
    with there.east.declare_subscriber(key, lambda sample: found.append(read(sample))):
        _known(there.east, there.west)
        act()
        settle(there.west)
        time.sleep(_ARRIVAL_S)
    return found


def _local(sample: zenoh.Sample, root: str) -> str:
    return str(sample.key_expr).removeprefix(root)


@_scenario
def sizes(there: Between, root: str) -> Any:
    def act() -> None:
        for n_bytes in (0, 1, 1024, 65_536, 1_000_000):
            there.west.put(f"{root}/a", bytes(n_bytes), congestion_control=zenoh.CongestionControl.BLOCK)

    return _heard(there, f"{root}/**", act, lambda sample: len(sample.payload.to_bytes()))


@_scenario
def priorities(there: Between, root: str) -> Any:
    names = ("REAL_TIME", "INTERACTIVE_HIGH", "INTERACTIVE_LOW", "DATA_HIGH", "DATA", "DATA_LOW", "BACKGROUND")

    def act() -> None:
        for name in names:
            there.west.put(f"{root}/{name}", b"x", priority=getattr(zenoh.Priority, name))

    return sorted(_heard(there, f"{root}/*", act, lambda sample: (_local(sample, root), str(sample.priority))))


@_scenario
def qualities(there: Between, root: str) -> Any:
    def act() -> None:
        for i, congestion in enumerate((zenoh.CongestionControl.DROP, zenoh.CongestionControl.BLOCK)):
            for express in (False, True):
                there.west.put(f"{root}/{i}/{express}", b"x", congestion_control=congestion, express=express)

    def read(sample: zenoh.Sample) -> Any:
        return _local(sample, root), str(sample.congestion_control), sample.express

    return sorted(_heard(there, f"{root}/**", act, read))


@_scenario
def attachments_and_encodings(there: Between, root: str) -> Any:
    def act() -> None:
        there.west.put(f"{root}/text", "text", encoding="text/plain;lang", attachment=bytes(range(33)))
        there.west.put(f"{root}/plain", b"x")
        there.west.put(f"{root}/json", b"{}", encoding=zenoh.Encoding.APPLICATION_JSON, attachment=b"a")

    def read(sample: zenoh.Sample) -> Any:
        attachment = b"" if sample.attachment is None else sample.attachment.to_bytes()
        return _local(sample, root), str(sample.encoding), attachment.hex(), sample.payload.to_bytes().hex()

    return sorted(_heard(there, f"{root}/**", act, read))


@_scenario
def timestamps_and_sources(there: Between, root: str) -> Any:
    def act() -> None:
        stamp = _stamp(0.5)
        there.west.put(f"{root}/stamped", b"t", timestamp=stamp)
        there.west.put(f"{root}/sourced", b"s", source_info=zenoh.SourceInfo(there.west.id, 41))

    def read(sample: zenoh.Sample) -> Any:
        source = None if sample.source_info is None else sample.source_info.source_sn
        stamp = str(sample.timestamp) if "stamped" in str(sample.key_expr) else None
        return _local(sample, root), stamp, source

    return sorted(_heard(there, f"{root}/**", act, read), key=str)


@_scenario
def wildcards_of_a_subscriber(there: Between, root: str) -> Any:
    def act() -> None:
        for key in ("a", "a/b", "a/b/c", "a/x/c", "b"):
            there.west.put(f"{root}/{key}", b"x")

    return sorted(_heard(there, f"{root}/a/*/c", act, lambda sample: _local(sample, root)))


@_scenario
def wildcards_of_a_put(there: Between, root: str) -> Any:
    return _heard(
        there, f"{root}/a/b", lambda: there.west.put(f"{root}/a/*", b"x"), lambda sample: _local(sample, root)
    )


@_scenario
def a_delete(there: Between, root: str) -> Any:
    def read(sample: zenoh.Sample) -> Any:
        return str(sample.kind), None if sample.attachment is None else sample.attachment.to_bytes().hex()

    return _heard(there, f"{root}/**", lambda: there.west.delete(f"{root}/gone", attachment=b"why"), read)


@_scenario
def keys_with_an_at_sign(there: Between, root: str) -> Any:
    key = f"@{root.replace('/', '_')}"
    return _heard(there, f"{key}/**", lambda: there.west.put(f"{key}/a", b"x"), lambda _: 1)


@_scenario
def the_order_of_a_thousand(there: Between, root: str) -> Any:
    def act() -> None:
        for i in range(1000):
            there.west.put(f"{root}/a", str(i), congestion_control=zenoh.CongestionControl.BLOCK)

    return _heard(there, f"{root}/**", act, lambda sample: int(sample.payload.to_string())) == list(range(1000))


@_scenario
def hearing_oneself(there: Between, root: str) -> Any:
    own: list[str] = []
    with there.west.declare_subscriber(f"{root}/**", lambda sample: own.append(_local(sample, root))):
        far = _heard(there, f"{root}/**", lambda: there.west.put(f"{root}/a", b"x"), lambda _: 1)
    return own, far


@_scenario
def both_ways_at_once(there: Between, root: str) -> Any:
    back: list[int] = []
    with there.west.declare_subscriber(f"{root}/back", lambda _: back.append(1)):

        def act() -> None:
            there.west.put(f"{root}/there", b"x")
            there.east.put(f"{root}/back", b"x")

        found = _heard(there, f"{root}/there", act, lambda _: 1)
    return found, back


@_scenario
def matching_status_without_a_subscriber(there: Between, root: str) -> Any:
    publisher = there.west.declare_publisher(f"{root}/a")
    _known(there.west, there.east)
    status = publisher.matching_status.matching  # type: ignore[attr-defined]
    publisher.undeclare()  # type: ignore[no-untyped-call]
    return status


@_scenario
def matching_status_with_a_subscriber(there: Between, root: str) -> Any:
    publisher = there.west.declare_publisher(f"{root}/a")
    with there.east.declare_subscriber(f"{root}/a", lambda _: None):
        _known(there.west, there.east)
        status = publisher.matching_status.matching  # type: ignore[attr-defined]
    publisher.undeclare()  # type: ignore[no-untyped-call]
    return status


def _executions(there: Between, root: str, target: zenoh.QueryTarget, complete: tuple[bool, bool]) -> Any:
    executed = Counter[int]()

    def taker(number: int) -> Any:
        def take(query: zenoh.Query) -> None:
            executed[number] += 1
            with query:
                query.reply(f"{root}/a", str(number))

        return zenoh.handlers.Callback(take, indirect=False)

    with ExitStack() as stack:
        other = stack.enter_context(a_client(there.east_end))
        for number, session in enumerate((there.east, other)):
            stack.enter_context(session.declare_queryable(f"{root}/**", taker(number), complete=complete[number]))
        _known(there.east, other, there.west)
        replies = list(
            there.west.get(
                f"{root}/a", target=target, consolidation=zenoh.ConsolidationMode.NONE, timeout=_TIME_OUT_S
            )
        )
    return sum(executed.values()), sum(reply.ok is not None for reply in replies)


@_scenario
def query_of_the_best_matching(there: Between, root: str) -> Any:
    return _executions(there, root, zenoh.QueryTarget.BEST_MATCHING, (True, True))


@_scenario
def query_of_all(there: Between, root: str) -> Any:
    return _executions(there, root, zenoh.QueryTarget.ALL, (True, True))


@_scenario
def query_of_all_complete(there: Between, root: str) -> Any:
    return _executions(there, root, zenoh.QueryTarget.ALL_COMPLETE, (True, True))


@_scenario
def query_of_all_of_incomplete_ones(there: Between, root: str) -> Any:
    return _executions(there, root, zenoh.QueryTarget.ALL, (False, False))


def _replies(
    there: Between, root: str, answer: Callable[[zenoh.Query], None], selector: str = "a", **options: Any
) -> list[Any]:
    """Return the replies to a query that ``answer`` answers in the east."""

    def take(query: zenoh.Query) -> None:
        with query:
            answer(query)

    callback = zenoh.handlers.Callback(take, indirect=False)
    with there.east.declare_queryable(f"{root}/**", callback):
        _known(there.east, there.west)
        replies = list(there.west.get(f"{root}/{selector}", timeout=_TIME_OUT_S, **options))
    return [
        (_local(one.ok, root), one.ok.payload.to_bytes().hex(), str(one.ok.kind), str(one.ok.encoding))
        if one.ok is not None
        else ("error", one.err.payload.to_bytes().hex() if one.err is not None else "")
        for one in replies
    ]


def _three(query: zenoh.Query) -> None:
    for i in range(3):
        query.reply(query.key_expr, str(i), timestamp=_stamp(i))


@_scenario
def consolidation_none(there: Between, root: str) -> Any:
    return _replies(there, root, _three, consolidation=zenoh.ConsolidationMode.NONE)


@_scenario
def consolidation_monotonic(there: Between, root: str) -> Any:
    return _replies(there, root, _three, consolidation=zenoh.ConsolidationMode.MONOTONIC)


@_scenario
def consolidation_latest(there: Between, root: str) -> Any:
    return _replies(there, root, _three, consolidation=zenoh.ConsolidationMode.LATEST)


@_scenario
def an_error_as_the_answer(there: Between, root: str) -> Any:
    return _replies(there, root, lambda query: query.reply_err(b"no"))


@_scenario
def a_delete_as_the_answer(there: Between, root: str) -> Any:
    return _replies(there, root, lambda query: query.reply_del(query.key_expr))


@_scenario
def what_a_query_carries(there: Between, root: str) -> Any:
    def answer(query: zenoh.Query) -> None:
        attachment = b"" if query.attachment is None else query.attachment.to_bytes()
        payload = b"" if query.payload is None else query.payload.to_bytes()
        query.reply(query.key_expr, f"{query.parameters} {query.encoding}".encode() + payload + attachment)

    return _replies(
        there, root, answer, "a?one=1;two", payload=b"12", encoding="text/plain", attachment=bytes(range(9))
    )


@_scenario
def an_answer_without_replies(there: Between, root: str) -> Any:
    return _replies(there, root, lambda _: None)


@_scenario
def a_query_for_nobody(there: Between, root: str) -> Any:
    begun_s = time.monotonic()
    replies = list(there.west.get(f"{root}/a", timeout=_TIME_OUT_S))
    return len(replies), time.monotonic() - begun_s < _TIME_OUT_S / 2


@_scenario
def a_query_that_times_out(there: Between, root: str) -> Any:
    held: list[zenoh.Query] = []
    with there.east.declare_queryable(f"{root}/**", held.append):
        _known(there.east, there.west)
        replies = list(there.west.get(f"{root}/a", timeout=1.0))
    for query in held:
        query.drop()  # type: ignore[no-untyped-call]
    return len(held), [reply.ok is not None for reply in replies]


@_scenario
def liveliness(there: Between, root: str) -> Any:
    events: list[tuple[str, str]] = []

    def take(sample: zenoh.Sample) -> None:
        events.append((_local(sample, root), str(sample.kind)))

    with there.west.liveliness().declare_token(f"{root}/early"):
        _known(there.west)
        watching = there.east.liveliness().declare_subscriber(f"{root}/**", take, history=True)
        time.sleep(_SPREAD_S)
        with there.west.liveliness().declare_token(f"{root}/late"):
            time.sleep(_SPREAD_S)
            present = _present(there, root)
        time.sleep(_ARRIVAL_S)
    time.sleep(_ARRIVAL_S)
    watching.undeclare()  # type: ignore[no-untyped-call]
    return events, present


def _present(there: Between, root: str) -> list[str]:
    """Return the live tokens, asked for by a client that watches none.

    In a session that watches them, Zenoh 1.10 may end a question before its answers, which then are events.
    """
    with a_client(there.east_end) as asking:
        replies = list(asking.liveliness().get(f"{root}/**"))
    return sorted(_local(reply.ok, root) for reply in replies if reply.ok is not None)


@_scenario
def tokens_of_a_client_that_goes(there: Between, root: str) -> Any:
    events: list[tuple[str, str]] = []
    with there.east.liveliness().declare_subscriber(
        f"{root}/**", lambda sample: events.append((_local(sample, root), str(sample.kind)))
    ):
        with a_client(there.west_end) as passing:
            held = [passing.liveliness().declare_token(f"{root}/{i}") for i in range(20)]
            _known(passing)
        time.sleep(_ARRIVAL_S)
        del held
    return sorted(events)


@_scenario
def a_cache_for_a_late_subscriber(there: Between, root: str) -> Any:
    stamping = configure("client", ZenohOptions(connect=[there.west_end], cfg=("timestamping/enabled:true",)))
    found: list[str] = []
    with zenoh.open(stamping) as west:
        _late_subscriber(there, west, root, found)
    return found


def _late_subscriber(there: Between, west: zenoh.Session, root: str, found: list[str]) -> None:
    publisher = ext.declare_advanced_publisher(
        west, f"{root}/state", cache=ext.CacheConfig(max_samples=100), publisher_detection=True
    )
    for i in range(5):
        publisher.put(str(i))
    _known(west)
    subscriber = ext.declare_advanced_subscriber(
        there.east, f"{root}/**", lambda sample: found.append(sample.payload.to_string()),
        history=ext.HistoryConfig(detect_late_publishers=True),
    )  # fmt: skip
    time.sleep(_SPREAD_S)
    publisher.put("5")
    time.sleep(_ARRIVAL_S)
    subscriber.undeclare()  # type: ignore[no-untyped-call]
    publisher.undeclare()  # type: ignore[no-untyped-call]


@_scenario
def a_cache_with_numbered_samples(there: Between, root: str) -> Any:
    publisher = ext.declare_advanced_publisher(
        there.west, f"{root}/state", cache=ext.CacheConfig(max_samples=100), publisher_detection=True,
        sample_miss_detection=ext.MissDetectionConfig(heartbeat=0.1, sporadic_heartbeat=None),
    )  # fmt: skip
    for i in range(5):
        publisher.put(str(i))
    _known(there.west)
    found: list[Any] = []

    def take(sample: zenoh.Sample) -> None:
        source = None if sample.source_info is None else sample.source_info.source_sn
        found.append((sample.payload.to_string(), source))

    subscriber = ext.declare_advanced_subscriber(
        there.east, f"{root}/**", take, history=ext.HistoryConfig(detect_late_publishers=True),
        recovery=ext.RecoveryConfig(heartbeat=True, periodic_queries=None),
    )  # fmt: skip
    time.sleep(_SPREAD_S)
    publisher.put("5")
    time.sleep(_ARRIVAL_S)
    subscriber.undeclare()  # type: ignore[no-untyped-call]
    publisher.undeclare()  # type: ignore[no-untyped-call]
    return found


@_scenario
def clients_that_come_and_go(there: Between, root: str) -> Any:
    def act() -> None:
        for i in range(12):
            with a_client(there.west_end) as passing:
                passing.put(f"{root}/{i}", b"x", congestion_control=zenoh.CongestionControl.BLOCK)
                settle(passing)

    return sorted(_heard(there, f"{root}/*", act, lambda sample: _local(sample, root)))


def crosses_after(there: Between, restart: Callable[[], None]) -> tuple[bool, bool, bool]:
    """Restart a router; tell whether puts, a token and a query cross again."""
    heard: list[int] = []

    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply("diff/restart/ask", b"yes")

    def asked() -> bool:
        replies = there.west.get("diff/restart/ask", timeout=1.0)
        return any(reply.ok is not None for reply in replies)

    with (
        there.east.declare_subscriber("diff/restart/put", lambda _: heard.append(1)),
        there.east.declare_queryable("diff/restart/ask", zenoh.handlers.Callback(answer, indirect=False)),
        there.west.liveliness().declare_token("diff/restart/token"),
    ):
        _known(there.west, there.east)
        restart()
        heard.clear()
        puts = soon(lambda: bool(there.west.put("diff/restart/put", b"x") or heard))
        tokens = soon(lambda: len(list(there.east.liveliness().get("diff/restart/token", timeout=1.0))) == 1)
        return puts, tokens, soon(asked)


def outcomes(there: Between, names: Collection[str] = SCENARIOS) -> dict[str, Any]:
    """Run scenarios at once; return what came of each, an exception as its text."""
    found: dict[str, Any] = {}

    def run(name: str, scenario: Scenario) -> None:
        try:
            found[name] = scenario(there, f"diff/{name}")
        except Exception as error:
            found[name] = f"{type(error).__name__}: {error}"

    threads = [threading.Thread(target=run, args=(name, SCENARIOS[name])) for name in names]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return found


def _told(west_end: str, east_end: str, *names: str) -> str:
    """Return what came of the scenarios as JSON, with the version of Zenoh."""
    with a_client(west_end) as west, a_client(east_end) as east:
        found = outcomes(Between(west, east, west_end, east_end), names)
    return json.dumps({"zenoh": version("eclipse-zenoh"), "outcomes": found})


if __name__ == "__main__":
    sys.stdout.write(_told(*sys.argv[1:]))
