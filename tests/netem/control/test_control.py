import json
from collections.abc import Mapping
from typing import Any, get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.netem.making import are_alike, link, offer, packet
from tis.common.channels import Direction
from tis.common.messages import encode
from tis.common.records import ControlNote
from tis.common.scenario.control import Acknowledgement, Operation, control_prefix
from tis.netem.conditions.timeline import MAX_ADDED
from tis.netem.control.control import Control
from tis.netem.control.request import MAX_CHANGES
from tis.netem.link.link import Link
from tis.netem.link.packet import Fate

MS = 1_000_000
NOW = 1_000_400_000  # 0.4 ms into cell 1000
EDGE = 1_001 * MS
SLOW = {"delay": {"kind": "constant", "delay_ms": 50}}
LOSSY = {"loss": {"kind": "bernoulli", "p_loss": 1}}
PROFILES: Mapping[str, Mapping[str, Any]] = {
    "plain": {"from_profile": "plain", "forward": SLOW, "feedback": {**SLOW, **LOSSY}},
    "moody": {"outages": [{"kind": "periodic", "every_s": 2, "for_s": 1}]},
}


def library(name: str) -> Mapping[str, Any]:
    if name not in PROFILES:
        raise LookupError("must be a profile of the library")
    return PROFILES[name]


def a_control(**network: Any) -> Control:
    links: dict[Direction, Link] = {way: link(way, **network) for way in get_args(Direction)}
    return Control(links, library=library)


def ask(control: Control, operation: str, request: Any, now_ns: int | None = NOW) -> Acknowledgement:
    answer, _ = control.handle(operation, json.dumps(request).encode(), now_ns)
    return answer


def fate(control: Control, at_ns: int, direction: Direction = "forward") -> Fate:
    return offer(control.links[direction], packet(at_ns), at_ns)


def delays_ms(control: Control, at_ns: int) -> list[float]:
    return [fate(control, at_ns, way).delay_ns / MS for way in get_args(Direction)]


def a_set(change: Mapping[str, Any], direction: str = "forward", **more: Any) -> dict[str, Any]:
    return {"direction": direction, "change": change, **more}


def test_a_change_holds_in_both_directions_from_the_next_ms_on() -> None:
    control = a_control()
    answer = ask(control, "set", a_set(SLOW, "both", id="x"))
    assert answer.model_dump(exclude_defaults=True) == {
        "id": "x", "operation": "set", "accepted": True, "at_ns": NOW, "from_ns": EDGE,
        "held": ({"direction": "forward", "from_ns": EDGE}, {"direction": "feedback", "from_ns": EDGE}),
    }  # fmt: skip
    assert delays_ms(control, EDGE - 1) == [0, 0]
    assert delays_ms(control, EDGE) == [50, 50]
    assert delays_ms(control, 3600 * 1000 * MS) == [50, 50]


def test_what_is_in_flight_is_not_touched() -> None:
    control = a_control(forward={"delay": {"kind": "constant", "delay_ms": 20}})
    fate(control, NOW)
    ask(control, "set", a_set(SLOW))
    ask(control, "outage", {"for_ms": 500})
    assert [due.release_ns for due in control.links["forward"].release(NOW + 20 * MS)] == [NOW + 20 * MS]


def test_a_list_of_changes_is_applied_at_one_instant() -> None:
    control = a_control()
    answer = ask(control, "set", [a_set(SLOW), a_set(LOSSY, "feedback", for_s=0.5)])
    assert answer.accepted
    assert [(one.direction, one.from_ns, one.until_ns) for one in answer.held] == [
        ("forward", EDGE, None), ("feedback", EDGE, EDGE + 500 * MS),
    ]  # fmt: skip
    assert [fate(control, EDGE - 1, way).outcome for way in get_args(Direction)] == ["deliver"] * 2
    assert fate(control, EDGE).delay_ns == 50 * MS
    assert fate(control, EDGE, "feedback").outcome == "loss"
    assert fate(control, EDGE + 500 * MS, "feedback").outcome == "deliver"


def test_a_list_is_applied_as_a_whole_or_not_at_all() -> None:
    control = a_control()
    answer = ask(control, "set", [a_set(SLOW, id="y"), a_set({"loss": {"kind": "bernoulli", "p_loss": 2}}), 7])
    assert (answer.accepted, answer.from_ns, answer.id) == (False, None, "y")
    assert answer.reasons == (
        "control: 1.change.loss.p_loss: must be at most 1 (got 2)",
        "control: 2: must be a mapping of keys to values (got 7)",
    )
    assert delays_ms(control, EDGE) == [0, 0]


def test_an_outage_lasts_as_long_as_it_says() -> None:
    control = a_control()
    answer = ask(control, "outage", {"direction": "feedback", "for_ms": 300})
    assert [(one.direction, one.from_ns, one.until_ns) for one in answer.held] == [
        ("feedback", EDGE, EDGE + 300 * MS)
    ]
    outcomes = [
        fate(control, at, "feedback").outcome for at in (EDGE - 1, EDGE, EDGE + 300 * MS - 1, EDGE + 300 * MS)
    ]
    assert outcomes == ["deliver", "outage", "outage", "deliver"]
    assert fate(control, EDGE).outcome == "deliver"


def test_reset_ends_everything_that_was_asked_for_and_nothing_else() -> None:
    control = a_control(timeline=[{"at_s": 0, "set": {"add_delay_ms": 7}}])
    ask(control, "set", a_set(SLOW, "both"))
    ask(control, "outage", {"for_ms": 60_000})
    later = NOW + 100 * MS
    answer = ask(control, "reset", {}, later)
    assert (answer.accepted, answer.from_ns) == (True, EDGE + 100 * MS)
    assert fate(control, later).outcome == "outage"
    assert delays_ms(control, EDGE + 100 * MS) == [7, 7]


def test_what_is_set_for_good_replaces_what_was_set_for_good() -> None:
    control = a_control(forward={"delay": {"kind": "constant", "delay_ms": 10}})
    for number, scale in enumerate((3, 2)):
        ask(control, "set", a_set({"scale_delay": scale}), NOW + number * 10 * MS)
    assert fate(control, EDGE + 9 * MS).delay_ns == 30 * MS
    assert fate(control, EDGE + 10 * MS).delay_ns == 20 * MS
    ask(control, "set", a_set({"scale_delay": 5}, for_s=1), NOW + 20 * MS)  # for a while: on top
    assert fate(control, EDGE + 20 * MS).delay_ns == 100 * MS
    ask(control, "set", a_set({"outage": True, "add_delay_ms": 1}), NOW + 30 * MS)
    assert fate(control, EDGE + 30 * MS).outcome == "outage"
    ask(control, "set", a_set({"outage": False}), NOW + 40 * MS)
    assert fate(control, EDGE + 40 * MS).delay_ns == 101 * MS


def test_a_moment_may_be_given_and_must_lie_ahead() -> None:
    control = a_control()
    assert ask(control, "set", a_set(SLOW, at_s=1.5)).from_ns == 1_500 * MS
    assert delays_ms(control, 1_500 * MS - 1)[0] == 0
    assert delays_ms(control, 1_500 * MS)[0] == 50
    assert ask(control, "set", a_set(SLOW, at_s=1.0)).reasons == (
        "control: at_s: must lie ahead: run time is 1.000 s (got 1.0)",
    )


def test_a_profile_replaces_every_stage() -> None:
    busy = {"loss": {"kind": "bernoulli", "p_loss": 1}, "rate": {"kbit_s": 1}, "ordering": "drop_late"}
    control = a_control(forward=busy, feedback={"delay": {"kind": "constant", "delay_ms": 5}})
    ask(control, "set", a_set({"scale_delay": 4}, "both"))
    assert ask(control, "profile", {"profile": "plain"}).accepted
    assert fate(control, EDGE) == Fate(0, "deliver", 50 * MS, EDGE + 50 * MS, foreign=True)
    assert fate(control, EDGE, "feedback").outcome == "loss"
    assert not control.links["forward"].has_queues


def test_a_profile_ends_what_was_asked_for_before_also_for_a_while() -> None:
    control = a_control(forward={"delay": {"kind": "constant", "delay_ms": 5}})
    ask(control, "set", a_set({"scale_delay": 2}, for_s=3600))
    ask(control, "set", a_set({"outage": True}, for_s=3600, at_s=30))
    assert ask(control, "profile", {"profile": "mine", "network": {"forward": SLOW}}, NOW + MS).accepted
    assert fate(control, EDGE).delay_ns == 10 * MS
    assert fate(control, EDGE + MS).delay_ns == 50 * MS
    assert fate(control, 31_000 * MS).outcome == "deliver"


def test_an_operation_that_is_none_is_named_before_its_payload_is_read() -> None:
    answer, _ = a_control().handle("sett", b"", NOW)
    assert answer.reasons == (
        "control: operation: must be one of set, outage, reset, profile; state and schema tell more (got 'sett')",
    )


@pytest.mark.parametrize(
    ("operation", "request_", "reason"),
    [
        (
            "profile",
            {"profile": "moody"},
            "profile: must be a static network to apply it during a run; this one has outages",
        ),
        ("profile", {"profile": "none"}, "profile: must be a profile of the library (got 'none')"),
        ("profile", {"profile": "../x.yaml"}, "profile: must consist of at most 64 letters"),
        ("set", [a_set(SLOW), a_set(SLOW, "both")], "1.change: must not set delay at the same time as change 0 does"),
        ("set", a_set({}), "change must set at least one field"),
        ("set", a_set(SLOW, ramp_s=0.6, for_s=1), "ramp_s must be at most half of for_s = 1.0"),
        ("set", a_set(SLOW, for_s=-1), "for_s: must be greater than 0 (got -1)"),
        ("set", a_set({"add_delay_ms": -1}), "change.add_delay_ms: must be at least 0 (got -1)"),
        ("set", a_set({"dealy": 1}), "change.dealy: unknown key, did you mean 'delay'? (got 1)"),
        ("set", a_set(SLOW, "west"), "'feedback' or 'both', did you mean 'forward'? (got 'west')"),
        ("set", a_set({"delay": {"kind": "trace", "path": "a.csv"}}), "must be a trace that the scenario names"),
        (
            "set",
            a_set({"rate": {"opportunities": "cell.up"}}),
            "change.rate.opportunities: must be a trace that the scenario names",
        ),
        ("set", [], f"must hold 1 to {MAX_CHANGES} changes (got 0)"),
        ("set", [a_set(SLOW)] * 33, f"must hold 1 to {MAX_CHANGES} changes (got 33)"),
        ("outage", {"for_ms": 86_400_001}, "for_ms: must be at most 8.64e+07"),
        ("outage", {"for_ms": 0}, "for_ms: must be at least 1 (got 0)"),
        ("outage", {}, "for_ms: is required"),
        ("reset", {"all": True}, "all: unknown key (got True)"),
        ("reset", None, "must be a mapping of keys to values"),
        ("stop", {}, "must be one of set, outage, reset, profile; state and schema tell more (got 'stop')"),
        ("set", a_set({"loss": {"kind": "trace", "path": "a.csv"}}, "both"), "control: change.loss.path: must be a"),
        (
            "set",
            [a_set(SLOW), a_set({"delay": {"kind": "trace", "path": "a.csv"}}, "feedback")],
            "control: 1.change.delay.path: must be a trace that the scenario names",
        ),
        ("reset", {"id": "x" * 101}, "id: must have at most 100 characters"),
        ("profile", {"profile": "mine", "network": {"states": 5}}, "profile: states: must be"),
    ],
)
def test_what_makes_no_sense_is_refused_with_its_reason(operation: str, request_: Any, reason: str) -> None:
    control = a_control()
    answer = ask(control, operation, request_)
    assert not answer.accepted
    assert reason in "\n".join(answer.reasons)
    assert delays_ms(control, EDGE) == [0, 0]
    assert control.links["forward"].conditions.is_constant


@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        (b"", "must be JSON: Expecting value at character 0"),
        (b"\xff\xfe", "must be UTF-8; byte 0 is not"),
        (b" " * 65_537, "must have at most 65536 bytes (got 65537)"),
        (b"[" * 60_000, "must be nested at most 20 levels deep"),
        (b"[" * 30 + b"]" * 30, "must be nested at most 20 levels deep"),
        (b'{"a": NaN}', "must be JSON: NaN is no number"),
        (b'{"for_ms": 1, "for_ms": 2}', "must be JSON: key 'for_ms' stands twice"),
        (b"9" * 5000, "must be JSON: Exceeds the limit"),
        (b'{"for_ms": 1e999}', "for_ms: must be"),
        (b'{"id": "\\ud800", "for_ms": 5}', "id: "),
        (b'{"\\ud800": 5}', "got '\\ud800'"),
    ],
)
def test_junk_is_refused_with_its_reason(payload: bytes, reason: str) -> None:
    answer, records = a_control().handle("outage", payload, NOW)
    assert not answer.accepted
    assert reason in "\n".join(answer.reasons)
    assert answer.model_dump_json()
    note = records[0].data
    assert isinstance(note, ControlNote)
    assert encode(note).decode()
    assert len(note.request) < 300


def test_nothing_is_changed_while_nothing_passes() -> None:
    answer = ask(a_control(), "set", a_set(SLOW), None)
    assert not answer.accepted
    assert answer.reasons == ("control: must come while messages pass: not before the run begins, nor after it",)


def test_the_log_says_what_was_asked_what_became_of_it_and_why_not() -> None:
    control = a_control()
    _, (accepted,) = control.handle("outage", b'{"for_ms": 250}', NOW)
    _, (refused,) = control.handle("set", b"x" * 300, NOW)
    assert (accepted.topic, accepted.log_ns) == ("/tis/control", NOW)
    assert accepted.data == ControlNote(
        at_ns=NOW, applied_ns=EDGE, operation="outage", request='{"for_ms": 250}', accepted=True,
        added='[{"at_s": 1.001, "for_s": 0.25, "ramp_s": 0.0, "direction": "both", "set": {"outage": true}}]',
    )  # fmt: skip
    assert refused.data == ControlNote(
        at_ns=NOW, applied_ns=0, operation="set", request="x" * 200 + "...", accepted=False,
        reason="control: must be JSON: Expecting value at character 0",
    )  # fmt: skip
    assert control.counters() == {"control.accepted": 1, "control.refused": 1}


def test_a_flood_of_changes_for_good_leaves_one() -> None:
    control = a_control()
    for number in range(1_500):
        assert ask(control, "set", a_set({"add_delay_ms": number}), number * MS).accepted
    assert len(control.links["forward"].conditions.added(1_500 * MS)) == 1
    assert fate(control, 1_501 * MS).delay_ns == 1_499 * MS


@pytest.fixture
def fifty_at_most(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tis.netem.conditions.timeline.MAX_ADDED", 50)
    monkeypatch.setattr("tis.netem.control.control.MAX_ADDED", 50)


@pytest.mark.usefixtures("fifty_at_most")
def test_a_flood_of_changes_for_a_while_is_refused_when_too_many_hold() -> None:
    assert MAX_ADDED == 1000
    control = a_control()
    for_long = a_set({"add_delay_ms": 0.001}, for_s=1000)
    answers = [ask(control, "set", for_long, NOW) for _ in range(51)]
    assert [answer.accepted for answer in answers] == [True] * 50 + [False]
    assert "forward: has 50 requested changes that hold now or later" in answers[-1].reasons[0]
    assert not ask(control, "set", [a_set({"add_delay_ms": 1}), a_set({"outage": True}, "feedback")]).accepted
    assert control.links["feedback"].conditions.is_constant
    assert ask(control, "reset", {}, NOW + MS).accepted
    assert ask(control, "set", for_long, NOW + 2 * MS).accepted


@pytest.mark.usefixtures("fifty_at_most")
def test_changes_that_are_over_make_room() -> None:
    control = a_control()
    for number in range(500):
        assert ask(control, "outage", {"for_ms": 1}, number * 10 * MS).accepted


@pytest.mark.usefixtures("fifty_at_most")
@given(changes_=st.lists(st.lists(st.integers(0, 2), min_size=1, max_size=3), max_size=40))
def test_what_is_accepted_always_finds_room(changes_: list[list[int]]) -> None:
    """The worst case: entries without an end that begin later and cut those before them in two."""
    control = a_control()
    names = ("add_delay_ms", "scale_delay", "add_p_loss")
    for number, which in enumerate(changes_):
        change = {names[i]: 1 for i in which}
        ask(control, "set", a_set(change, "both", at_s=2 + number / 10), NOW)
        assert len(control.links["forward"].conditions.added(NOW)) <= 50


numbers = st.one_of(st.integers(-5, 5), st.floats(-1e9, 1e9), st.sampled_from([0, 0.5, 1, 1e-9, 1e6, True, "1"]))
words = st.sampled_from(
    [
        "direction",
        "change",
        "for_s",
        "ramp_s",
        "at_s",
        "id",
        "forward",
        "both",
        "kind",
        "constant",
        "bernoulli",
        "normal",
        "delay_ms",
        "mean_ms",
        "std_ms",
        "p_loss",
        "loss",
        "delay",
        "jitter",
        "correlation",
        "half_life_s",
        "rate",
        "kbit_s",
        "outage",
        "scale_delay",
        "for_ms",
        "profile",
        "plain",
        "reorder",
        "ordering",
        "early_ms",
        "clean",
    ]
) | st.text(max_size=3)
values = st.recursive(
    numbers | words | st.none(), lambda below: st.lists(below, max_size=3) | st.dictionaries(words, below, max_size=4)
)
ms = st.floats(0, 1e5)
p = st.floats(0, 1)
delays = st.one_of(
    st.fixed_dictionaries({"kind": st.just("constant"), "delay_ms": ms}),
    st.fixed_dictionaries({"kind": st.just("normal"), "mean_ms": ms, "std_ms": ms}),
    st.fixed_dictionaries({"kind": st.just("lognormal"), "mean_ms": ms, "std_ms": ms}),
    st.fixed_dictionaries({"kind": st.just("gamma"), "mean_ms": ms, "std_ms": ms}),
    st.fixed_dictionaries({"kind": st.just("pareto"), "scale_ms": ms, "shape": st.floats(0, 10)}),
)
losses = st.one_of(
    st.fixed_dictionaries({"kind": st.just("bernoulli"), "p_loss": p}),
    st.fixed_dictionaries({"kind": st.just("burst"), "p_loss": p, "mean_burst": st.floats(1, 50)}),
    st.fixed_dictionaries({"kind": st.just("gilbert_elliott"), "p_bad": p, "p_good": p}),
)
changes = st.fixed_dictionaries(
    {},
    optional={
        "delay": delays,
        "loss": losses,
        "jitter": st.fixed_dictionaries({"kind": st.just("normal"), "std_ms": ms}),
        "correlation": st.fixed_dictionaries({"half_life_s": st.floats(0.001, 100)}),
        "clean": st.booleans(),
        "scale_delay": st.floats(0, 2000),
        "outage": st.booleans(),
    },
)
likely = st.fixed_dictionaries(
    {"direction": st.sampled_from(["forward", "feedback", "both"]), "change": changes},
    optional={"for_s": st.floats(-1, 10), "ramp_s": st.floats(0, 2), "at_s": st.floats(0, 5)},
)
requests = st.one_of(values, likely, st.lists(likely, max_size=3))
payloads = st.one_of(st.binary(max_size=60), requests.map(lambda one: json.dumps(one).encode()))


@settings(max_examples=300)
@given(operation=st.sampled_from([*get_args(Operation), "state", "x"]), payload=payloads)
def test_no_payload_raises_and_none_that_is_refused_changes_anything(operation: str, payload: bytes) -> None:
    control = a_control(forward={"delay": {"kind": "constant", "delay_ms": 3}})
    answer, (record,) = control.handle(operation, payload, NOW)
    assert Acknowledgement.model_validate_json(answer.model_dump_json()) == answer
    assert isinstance(record.data, ControlNote)
    assert answer.accepted == (not answer.reasons)
    assert fate(control, NOW) == Fate(0, "deliver", 3 * MS, NOW + 3 * MS, foreign=True)
    if not answer.accepted:
        assert control.links["forward"].conditions.is_constant
        assert control.links["feedback"].conditions.is_constant
    for at_ns in (EDGE, 6_000 * MS):  # what was accepted can be carried out
        for way in get_args(Direction):
            fate(control, at_ns, way)


def test_control_keys_lie_below_the_session() -> None:
    assert control_prefix("tis") == "tis/netem/control/"


standing = st.lists(st.tuples(changes.filter(bool), st.booleans()), min_size=1, max_size=6)


@given(asked=standing)
def test_what_holds_for_good_is_the_last_word_on_each_thing(asked: list[tuple[dict[str, Any], bool]]) -> None:
    """The oracle merges mappings; the links keep windows of a timeline."""
    control = a_control(forward={"delay": {"kind": "constant", "delay_ms": 3}, "ordering": "drop_late"})
    told: dict[str, Any] = {}
    for number, (change, _) in enumerate(asked):
        if ask(control, "set", a_set(change), number * MS).accepted:
            if change.get("clean"):
                told = {key: value for key, value in told.items() if key in ("outage", "scale_delay")}
            told |= change
    one = a_control(forward={"delay": {"kind": "constant", "delay_ms": 3}, "ordering": "drop_late"})
    if told:
        assert ask(one, "set", a_set(told), 0).accepted
    found, expected = (made.links["forward"].conditions.at(7 * MS) for made in (control, one))
    assert are_alike(found, expected)
