"""What a live run's log says is enough to make its changes again."""

import json
from typing import Any, get_args

from hypothesis import given, settings
from hypothesis import strategies as st

from tests.netem.making import are_alike, link, offer, packet, scenario
from tis.common.channels import Direction
from tis.common.messages import decode, encode
from tis.common.records import FATES, ControlNote, FateBatch
from tis.common.zenoh_syntax import KeySet
from tis.netem.conditions.conditions import Condition
from tis.netem.control.control import Control
from tis.netem.control.replay import changed_conditions, changes_from_notes, with_live_changes
from tis.netem.link.link import Link
from tis.netem.node import NetemNode

MS = 1_000_000
NETWORK: dict[str, Any] = {"forward": {"delay": {"kind": "uniform", "low_ms": 1, "high_ms": 9}}}
SCALED = {"direction": "forward", "change": {"scale_delay": 3}}


def _links() -> dict[Direction, Link]:
    return {way: link(way, **NETWORK) for way in get_args(Direction)}


def _noted(control: Control, operation: str, request: Any, at_ns: int) -> ControlNote:
    _, (record,) = control.handle(operation, json.dumps(request).encode(), at_ns)
    assert isinstance(record.data, ControlNote)
    return decode(encode(record.data), ControlNote)


def test_changes_and_clearings_have_the_run_times_at_which_they_came() -> None:
    control = Control(_links())
    notes = [
        _noted(control, "set", SCALED, 5_300_000),
        _noted(control, "set", {"junk": 1}, 6_000_000),
        _noted(control, "outage", {"for_ms": 20, "direction": "feedback"}, 7_000_000),
        _noted(control, "reset", {}, 9_900_000),
    ]
    scaled, outage, reset = changes_from_notes(notes)
    assert [(change.at_ns, change.cleared) for change in (scaled, outage, reset)] == [
        (5_300_000, False), (7_000_000, False), (9_900_000, True),
    ]  # fmt: skip
    added = [change.entries[0] for change in (scaled, outage)]
    assert [(entry.at_s, entry.for_s, entry.direction) for entry in added] == [
        (0.006, None, "forward"), (0.008, 0.02, "feedback"),
    ]  # fmt: skip
    assert added[0].set.model_dump(exclude_unset=True) == {"scale_delay": 3.0}
    assert reset.entries == ()


changes = st.fixed_dictionaries(
    {},
    optional={
        "scale_delay": st.integers(0, 4),
        "add_delay_ms": st.integers(0, 4),
        "outage": st.booleans(),
        "clean": st.booleans(),
        "loss": st.just({"kind": "bernoulli", "p_loss": 0.5}),
    },
).filter(bool)
sets = st.fixed_dictionaries(
    {"direction": st.sampled_from(["forward", "feedback", "both"]), "change": changes},
    optional={"for_s": st.floats(0.001, 0.03), "at_s": st.floats(0, 0.06)},
)
asked: st.SearchStrategy[tuple[str, Any]] = st.one_of(
    st.tuples(st.just("set"), sets | st.lists(sets, max_size=2)),
    st.tuples(st.just("outage"), st.fixed_dictionaries({"for_ms": st.floats(1, 20)})),
    st.tuples(st.just("reset"), st.just({})),
    st.tuples(st.just("profile"), st.just({"profile": "mine", "network": {"forward": {"ordering": "reorder"}}})),
)


@settings(max_examples=50)
@given(requests=st.lists(st.tuples(st.integers(0, 60 * MS), asked), max_size=8).map(lambda one: sorted(one, key=_at)))
def test_the_changes_made_again_decide_the_same_fates(requests: list[tuple[int, tuple[str, Any]]]) -> None:
    """The oracle is the live links themselves, changed between the packets."""
    links = _links()
    control = Control(links)
    notes: list[ControlNote] = []
    waiting = list(requests)
    live: list[tuple[str, int]] = []
    offers = [(at_ns, seq) for seq, at_ns in enumerate(range(0, 80 * MS, 700_000))]
    for at_ns, seq in offers:
        while waiting and waiting[0][0] <= at_ns:
            asked_ns, (operation, request) = waiting.pop(0)
            notes.append(_noted(control, operation, request, asked_ns))
        for way in get_args(Direction):
            fate = offer(links[way], packet(at_ns, seq), at_ns)
            live.append((fate.outcome, fate.delay_ns))
    node = with_live_changes(NetemNode(**_links(), local=KeySet()), notes)
    for at_ns, seq in offers:
        for network in ("west", "east"):
            node.receive(packet(at_ns, seq, network=network))
    batches: dict[str, FateBatch] = {}
    for record in node.finish(100 * MS):
        if record.topic == FATES:
            batch = record.data
            assert isinstance(batch, FateBatch)
            batches[batch.direction] = batch
    both = [list(zip(batches[way].outcome, batches[way].delay_ns, strict=True)) for way in get_args(Direction)]
    assert live == [fate for pair in zip(*both, strict=True) for fate in pair]


@settings(max_examples=50)
@given(requests=st.lists(st.tuples(st.integers(0, 60 * MS), asked), max_size=8).map(lambda one: sorted(one, key=_at)))
def test_looking_back_finds_what_held(requests: list[tuple[int, tuple[str, Any]]]) -> None:
    """The oracle is the live links' conditions at the time, between two requests."""
    links = _links()
    control = Control(links)
    notes: list[ControlNote] = []
    waiting = list(requests)
    held: list[tuple[int, Condition]] = []
    for at_ns in range(0, 90 * MS, 500_000):
        while waiting and waiting[0][0] < at_ns:
            asked_ns, (operation, request) = waiting.pop(0)
            notes.append(_noted(control, operation, request, asked_ns))
        held.append((at_ns, links["forward"].conditions.at(at_ns)))
    back = changed_conditions(scenario(**NETWORK).network, "forward", 7, notes)
    for at_ns, condition in [*held, *held[::-7]]:
        found = back.at(at_ns)
        assert are_alike(found, condition)
        assert at_ns < found.until_ns
    spans = back.spans(90 * MS)
    assert [span.begin_ns for span in spans] == [0, *(span.end_ns for span in spans[:-1])]
    assert spans[-1].end_ns == 90 * MS
    for at_ns, condition in held:
        (over,) = [span for span in spans if span.begin_ns <= at_ns < span.end_ns]
        assert over.outage == condition.outage
        assert over.changed or are_alike(condition, Condition())


def _at(request: tuple[int, Any]) -> int:
    return request[0]
