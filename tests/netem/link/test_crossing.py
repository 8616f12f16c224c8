"""A packet that nothing holds back: what is saved must not change what is decided, counted or logged."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import asdict

from tests.netem.making import KEY, link, packet
from tis.common.messages import Message
from tis.common.node import Arrival
from tis.netem.link.link import Link

MS = 1_000_000
SECOND_KEY = "tis/MTMR/measured_cp"
DELAYED = {"delay": {"kind": "constant", "delay_ms": 2}}
HALF_LOST = {"loss": {"kind": "bernoulli", "p_loss": 0.5}}
Books = dict[tuple[str, str, bool], dict[int, tuple[Any, ...]]]


def _slowly(made: Link, one: Arrival, now_ns: int) -> None:
    """What `offer` and `release` do: the oracle."""
    made.offer(one.key, one.attachment, len(one.payload), now_ns, one)
    for due in made.release(now_ns):
        made.left(due, now_ns)


def _quickly(made: Link, one: Arrival, now_ns: int) -> bool:
    n_bytes = len(one.payload)
    if not made.lets_through(one.key, n_bytes + len(one.attachment), now_ns):
        _slowly(made, one, now_ns)
        return False
    made.crossed(one.key, one.attachment, n_bytes, now_ns, now_ns)
    return True


def _columns(made: Link) -> Books:
    """The log, packet by packet: topic, key and foreign -> place -> row."""
    books: Books = {}
    for record in made.ledger.close(0)():
        assert isinstance(record.data, Message)
        rows = asdict(record.data)
        names = [name for name, column in rows.items() if isinstance(column, tuple | list) and column]
        key = (record.topic, rows["key"], rows["foreign"])
        columns = sorted(zip(*(rows[name] for name in names), strict=True))
        books.setdefault(key, {}).update(dict(enumerate(columns)))
    return books


def _offers() -> st.SearchStrategy[list[tuple[int, str, int | None, int]]]:
    one = st.tuples(
        st.integers(0, 3 * MS),
        st.sampled_from([KEY, SECOND_KEY, "nobody/knows"]),
        st.none() | st.integers(0, 50),
        st.integers(0, 200),
    )
    return st.lists(one, max_size=40)


@settings(deadline=None, max_examples=80)
@given(
    offers=_offers(),
    ordering=st.sampled_from(["fifo", "reorder", "drop_late"]),
    second=st.sampled_from([{}, DELAYED, HALF_LOST]),
    timeline=st.sampled_from(
        [[], [{"at_s": 0.01, "for_s": 0.01, "set": {"outage": True}}], [{"at_s": 0.02, "set": {"scale_delay": 2.0}}],
         [{"at_s": 0.005, "for_s": 0.02, "set": {"delay": {"kind": "constant", "delay_ms": 3}}}]]
    ),
    room=st.sampled_from([{}, {"max_packets": 1}, {"max_mb": 0.0011}, {"max_packets": 2, "policy": "drop_oldest"}]),
)  # fmt: skip
def test_crossing_is_offering_and_releasing(
    offers: list[tuple[int, str, int | None, int]],
    ordering: str,
    second: dict[str, Any],
    timeline: list[dict[str, Any]],
    room: dict[str, Any],
) -> None:
    def make() -> Link:
        return link(
            forward={"ordering": ordering},
            rules=[{"key": SECOND_KEY, "direction": "forward", "pipeline": {"ordering": ordering, **second}}],
            timeline=timeline,
            buffer=room,
        )

    slow, quick = make(), make()
    now_ns = 0
    for gap_ns, key, seq, size in offers:
        now_ns += gap_ns
        for made in (slow, quick):
            for due in made.release(now_ns):
                made.left(due, now_ns)
        one = packet(now_ns, seq, key, b"x" * size)
        _slowly(slow, one, now_ns)
        _quickly(quick, one, now_ns)
    assert quick.counters() == slow.counters()
    assert _columns(quick) == _columns(slow)


def _crosses(network: dict[str, Any], now_ns: int = 5 * MS) -> bool:
    made = link(**network)
    _slowly(made, packet(0, 0), 0)
    return _quickly(made, packet(now_ns, 1), now_ns)


def test_what_is_not_impaired_crosses() -> None:
    assert _crosses({})
    assert _crosses({"forward": {"ordering": "reorder"}})


@pytest.mark.parametrize(
    "network",
    [
        {"forward": {"delay": {"kind": "constant", "delay_ms": 1}}},
        {"forward": {"loss": {"kind": "bernoulli", "p_loss": 0.1}}},
        {"forward": {"rate": {"kbit_s": 1000}}},
        {"forward": {"corrupt": {"p_corrupt": 0.1}}},
        {"forward": {"duplicate": {"p_duplicate": 0.1}}},
        {"forward": {"ordering": "drop_late"}},
        {"timeline": [{"at_s": 0.004, "for_s": 1, "set": {"outage": True}}]},
        {"timeline": [{"at_s": 0.004, "for_s": 1, "set": {"add_delay_ms": 1}}]},
    ],
)
def test_what_is_impaired_does_not(network: dict[str, Any]) -> None:
    assert not _crosses(network)


def test_a_key_that_is_new_does_not_cross_and_is_opened() -> None:
    made = link()
    assert not made.lets_through(KEY, 20, 0)
    _slowly(made, packet(0, 0), 0)
    assert made.lets_through(KEY, 20, 0)


def test_nothing_crosses_while_something_is_held() -> None:
    slow_rule = {
        "key": SECOND_KEY,
        "direction": "forward",
        "pipeline": {"delay": {"kind": "constant", "delay_ms": 9}},
    }
    made = link(rules=[slow_rule])
    _slowly(made, packet(0, 0), 0)
    made.offer(SECOND_KEY, b"", 5, 1 * MS, None)
    assert not made.lets_through(KEY, 20, 2 * MS)
    assert [due.name for due in made.release(10 * MS)] == [SECOND_KEY]
    assert made.lets_through(KEY, 20, 11 * MS)
