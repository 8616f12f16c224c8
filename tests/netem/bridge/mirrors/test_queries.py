"""Queries through a real bridge. The oracle is a Zenoh router: whoever asks gets the same from both."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import pytest
import zenoh

from tests.common.runtime.live_zenoh import a_network, settle, soon
from tests.netem.bridge.live_bridge import a_bridge, delays, n_mirrored, n_open
from tis.netem.bridge.mirrors.queries import _Question

pytestmark = pytest.mark.live

Seen = list[tuple[object, ...]]


def answer(query: zenoh.Query) -> None:
    """Answer in the way that the query's parameters ask for."""
    with query:
        match str(query.parameters).split(";")[0]:
            case "error":
                query.reply_err(b"no", encoding="text/plain;it")
            case "delete":
                query.reply_del("demo/gone", attachment=b"why")
            case "several":
                for i in range(3):
                    query.reply(f"demo/{i}", str(i))
            case "elsewhere":
                query.reply("other/key", b"")
            case "silence":
                pass
            case _:
                text = "" if query.payload is None else query.payload.to_string()
                query.reply(
                    "demo/a", f"{query.selector} {text} {query.encoding} {query.accepts_replies()}",
                    encoding="text/plain", attachment=query.attachment, express=True,
                )  # fmt: skip


def ask(session: zenoh.Session, selector: str, **options: Any) -> Seen:
    """Return all that can be read of the replies, in any order."""
    seen: Seen = []
    for reply in session.get(selector, timeout=3.0, **options):
        ok, err = reply.ok, reply.err
        if ok is not None:
            attachment = None if ok.attachment is None else ok.attachment.to_bytes()
            seen.append((str(ok.key_expr), ok.payload.to_bytes(), str(ok.encoding), ok.kind, attachment))
        else:
            seen.append(("error", err.payload.to_bytes(), str(err.encoding)))
    return sorted(seen, key=repr)


@contextmanager
def a_queryable(session: zenoh.Session, key: str, complete: bool = False) -> Iterator[list[str]]:
    asked: list[str] = []

    def take(query: zenoh.Query) -> None:
        asked.append(str(query.selector))
        answer(query)

    with session.declare_queryable(key, take, complete=complete):
        settle(session)
        yield asked


def test_who_asks_gets_the_same_as_from_a_router() -> None:
    questions: list[tuple[str, dict[str, Any]]] = [
        ("demo/**?error", {}),
        ("demo/**?delete", {}),
        ("demo/*?several", {}),
        ("demo/**?silence", {}),
        ("demo/**?elsewhere", {"accept_replies": zenoh.ReplyKeyExpr.ANY}),
        ("demo/a", {}),
        ("demo/a?x=1;y=2", {"payload": b"hello", "encoding": "text/json", "attachment": bytes(range(33))}),
        ("demo/a", {"target": zenoh.QueryTarget.ALL, "consolidation": zenoh.ConsolidationMode.NONE}),
    ]
    with a_network() as network, a_queryable(network.router, "demo/**"):
        expected = [ask(network.client, selector, **options) for selector, options in questions]
    assert [len(seen) for seen in expected] == [1, 1, 3, 0, 1, 1, 1, 1]
    with a_bridge() as there, a_queryable(there.east, "demo/**"):
        assert soon(lambda: n_mirrored(there) == 1)
        assert [ask(there.west, selector, **options) for selector, options in questions] == expected
        assert n_open(there) == 0
    with a_bridge() as there, a_queryable(there.west, "demo/**"):  # and the other way round
        assert soon(lambda: n_mirrored(there) == 1)
        assert [ask(there.east, selector, **options) for selector, options in questions] == expected


def test_question_and_reply_take_the_delay_of_their_direction() -> None:
    links = delays(100.0) | {"feedback": {"delay": {"kind": "constant", "delay_ms": 150.0}}}
    with a_bridge(**links) as there, a_queryable(there.east, "demo/**"):
        assert soon(lambda: n_mirrored(there) == 1)
        took_s = []
        for _ in range(3):
            began_s = time.monotonic()
            assert len(ask(there.west, "demo/a")) == 1
            took_s.append(time.monotonic() - began_s)
        assert 0.25 <= min(took_s) < 0.5  # the quickest: a busy machine is late now and then
        held = [link.held for link in there.bridge.links.values()]
        assert held == [0, 0]


def test_where_nobody_lists_them_one_queryable_stands_for_all() -> None:
    """As in a run: nothing is mirrored one by one, and who asks gets the answer none the less."""
    with a_bridge(ways={}) as there, a_queryable(there.east, "demo/**"):
        assert soon(lambda: len(ask(there.west, "demo/a")) == 1)
        assert n_mirrored(there) == 0
        assert ask(there.west, "other/a") == []
        assert soon(lambda: n_open(there) == 0)


def test_a_question_that_nobody_answers_ends_at_once_though_the_link_is_slow() -> None:
    with a_bridge(**delays(5_000.0)) as there, a_queryable(there.east, "other/**"):
        assert soon(lambda: n_mirrored(there) == 1)
        began_s = time.monotonic()
        assert ask(there.west, "demo/a") == []
        assert time.monotonic() - began_s < 2.5  # it would take 10 s there and back, and who asks waits for 3


def test_a_lost_question_leaves_the_querier_to_its_time_out_and_nothing_behind() -> None:
    lossy = {"forward": {"loss": {"kind": "bernoulli", "p_loss": 1.0}}}
    with a_bridge(time_out_s=2.0, **lossy) as there, a_queryable(there.east, "demo/**") as asked:
        assert soon(lambda: n_mirrored(there) == 1)
        replies = list(there.west.get("demo/a", timeout=0.2))
        # on a busy machine Zenoh may say it twice
        assert {reply.err and reply.err.payload.to_bytes() for reply in replies} == {b"Timeout"}
        assert n_open(there) == 1
        assert soon(lambda: n_open(there) == 0)
        assert there.applications.queries.n_timed_out == 1
        assert asked == []


def test_lost_replies_are_missing_and_the_end_arrives_by_itself() -> None:
    rules = [
        {"key": "demo/1", "direction": "feedback", "pipeline": {"loss": {"kind": "bernoulli", "p_loss": 1.0}}},
    ]
    with a_bridge(rules=rules) as there, a_queryable(there.east, "demo/**"):
        assert soon(lambda: n_mirrored(there) == 1)
        assert [seen[0] for seen in ask(there.west, "demo/*?several")] == ["demo/0", "demo/2"]
        assert there.applications.queries.n_finished == 1


def test_complete_queryables_are_found_by_those_who_want_them() -> None:
    """As ROS 2's service clients do; and one that is not complete is not asked."""
    complete = {"target": zenoh.QueryTarget.ALL_COMPLETE}
    with a_bridge() as there, a_queryable(there.east, "srv/add", complete=True):
        with a_queryable(there.east, "demo/a") as asked:
            assert soon(lambda: n_mirrored(there) == 2)
            assert len(ask(there.west, "srv/add?silence", **complete)) == 0
            assert there.applications.queries.n_asked == 1
            assert ask(there.west, "demo/a", **complete) == []
            assert asked == []
        assert soon(lambda: n_mirrored(there) == 1)


def test_a_query_that_matches_several_mirrors_is_asked_once() -> None:
    with a_bridge() as there, a_queryable(there.east, "demo/a") as one, a_queryable(there.east, "demo/b/**") as two:
        with a_queryable(there.east, "demo/b/c", complete=True) as three:
            assert soon(lambda: n_mirrored(there) == 3)
            ask(there.west, "demo/**?silence", target=zenoh.QueryTarget.ALL)
            assert (len(one), len(two), len(three)) == (1, 1, 1)
            ask(there.west, "**?silence", target=zenoh.QueryTarget.ALL)
            assert (len(one), len(two), len(three)) == (2, 2, 2)
        assert there.applications.queries.n_asked == 2


def test_only_what_crosses_is_asked() -> None:
    with (
        a_bridge(keys=["demo/**"]) as there,
        a_queryable(there.east, "demo/**") as inside,
        a_queryable(there.east, "other/**") as outside,
    ):
        assert soon(lambda: n_mirrored(there) == 1)
        assert len(ask(there.west, "**", target=zenoh.QueryTarget.ALL)) == 1
        assert len(inside) == 1
        assert outside == []


def test_a_thousand_queries_leave_nothing_behind() -> None:
    with a_bridge(**delays(5.0)) as there, a_queryable(there.east, "demo/**"):
        assert soon(lambda: n_mirrored(there) == 1)
        handlers = [there.west.get("demo/a", timeout=5.0) for _ in range(1000)]
        assert sum(len(list(handler)) for handler in handlers) == 1000
        counts = there.applications.queries.counters()
        assert (counts["queries.asked"], counts["queries.replies"], counts["queries.finished"]) == (1000,) * 3
        assert n_open(there) == 0


class _Dropped:
    """A query that was finished while its question crossed: Zenoh refuses all that is asked of it."""

    @property
    def payload(self) -> None:
        raise zenoh.ZError("Dropped query")


def test_a_question_that_is_released_after_its_time_out_ends_nothing() -> None:
    queries: Any = SimpleNamespace(bridge=SimpleNamespace(guarded=None), n_unsent=0, forget=lambda _: False)
    question: Any = _Question(queries, "forward", "demo/a", _Dropped())  # type: ignore[arg-type]
    question.forward(None)
    assert queries.n_unsent == 1
