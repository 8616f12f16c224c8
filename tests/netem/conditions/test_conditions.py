from functools import cache
from math import prod
from typing import Any, get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.netem.making import are_alike, is_out, state_at
from tis.common.channels import Direction
from tis.common.scenario.network import NetworkPart
from tis.common.scenario.network.conditions import Change, TimelineEntry
from tis.common.scenario.network.pipeline import Pipeline
from tis.netem.conditions.conditions import FOREVER_NS, Condition, Conditions, Span, merged
from tis.netem.conditions.outage import outages_of
from tis.netem.conditions.states import StatePath

MS = 1_000_000
S = 1_000 * MS
CONSTANT = {"kind": "constant", "delay_ms": 5}
NORMAL = {"kind": "normal", "std_ms": 1}
BERNOULLI = {"kind": "bernoulli", "p_loss": 0.1}


def _conditions(direction: Direction = "forward", seed: int = 1, **network: Any) -> Conditions:
    return Conditions.of(NetworkPart.model_validate(network), direction, seed)


def _entry(at_s: float, for_s: float | None = None, direction: str = "both", **change: Any) -> TimelineEntry:
    ramp_s = change.pop("ramp_s", 0)
    return TimelineEntry.model_validate(
        {"at_s": at_s, "for_s": for_s, "ramp_s": ramp_s, "direction": direction, "set": change}
    )


def _change(**raw: Any) -> Change:
    return Change.model_validate(raw)


def test_nothing_to_change() -> None:
    conditions = _conditions(timeline=[_entry(1, 1, "feedback", outage=True)])
    assert conditions.is_constant
    assert conditions.at(0) == conditions.at(10**18) == Condition()
    assert conditions.at(-1).since_ns < -(10**18)
    assert conditions.spans(5 * S) == [Span(0, 5 * S, None, False, False)]


def test_a_run_to_the_nanosecond() -> None:
    conditions = _conditions(
        outages=[{"kind": "periodic", "every_s": 10, "for_s": 0.5}],
        states={
            "kind": "script",
            "states": [{"name": "bad", "forward": {"scale_delay": 2, "add_p_loss": 0.5, "loss": BERNOULLI}}],
            "steps": [{"at_s": 4, "state": "bad"}],
        },
        timeline=[_entry(9, 3, scale_delay=3, add_delay_ms=0.25, add_p_loss=0.5), _entry(11, 1, delay=CONSTANT)],
    )
    assert not conditions.is_constant
    bad, bad_and_late = (_change(loss=BERNOULLI),), (_change(loss=BERNOULLI, delay=CONSTANT),)
    told = [conditions.at(now_ns) for now_ns in (0, 4 * S, 9 * S, 10 * S, 10_500 * MS, 11 * S, 12 * S, 20 * S)]
    assert told == [
        Condition(4 * S),
        Condition(9 * S, False, bad, 2.0, 0, 0.5, "bad", 4 * S),
        Condition(10 * S, False, bad, 6.0, 250_000, 0.75, "bad", 9 * S),
        Condition(10_500 * MS, True, bad, 6.0, 250_000, 0.75, "bad", 10 * S),
        Condition(11 * S, False, bad, 6.0, 250_000, 0.75, "bad", 10_500 * MS),
        Condition(12 * S, False, bad_and_late, 6.0, 250_000, 0.75, "bad", 11 * S),
        Condition(20 * S, False, bad, 2.0, 0, 0.5, "bad", 12 * S),
        Condition(20_500 * MS, True, bad, 2.0, 0, 0.5, "bad", 20 * S),
    ]
    for condition in told[1:]:
        assert conditions.at(condition.since_ns) == conditions.at(condition.until_ns - 1) == condition
        assert conditions.at(condition.since_ns - 1) != condition
    assert told[1].changes is told[4].changes is told[6].changes
    assert are_alike(told[1], told[6])
    assert not are_alike(told[1], told[2])
    assert conditions.spans(20_100 * MS) == [
        Span(0, 4 * S, None, False, False),
        Span(4 * S, 9 * S, "bad", False, False),
        Span(9 * S, 10 * S, "bad", False, True),
        Span(10 * S, 10_500 * MS, "bad", True, True),
        Span(10_500 * MS, 12 * S, "bad", False, True),
        Span(12 * S, 20 * S, "bad", False, False),
        Span(20 * S, 20_100 * MS, "bad", True, False),
    ]
    script = {"kind": "script", "states": [{"name": "bad"}], "steps": [{"at_s": 4, "state": "bad"}]}
    feedback = _conditions("feedback", states=script)
    assert feedback.at(5 * S) == Condition(state="bad", since_ns=4 * S)


def test_a_ramp_goes_by_cells_and_is_one_span() -> None:
    conditions = _conditions(
        timeline=[_entry(1, 0.1, ramp_s=0.004, scale_delay=3, add_delay_ms=2, add_p_loss=0.4, loss=BERNOULLI)]
    )
    told = [conditions.at(1 * S + i * MS) for i in range(5)]
    assert [condition.scale_delay for condition in told] == [1.0, 1.5, 2.0, 2.5, 3.0]
    assert [condition.add_delay_ns for condition in told] == [0, 500_000, 1_000_000, 1_500_000, 2_000_000]
    assert [condition.p_extra_loss for condition in told] == pytest.approx([0, 0.1, 0.2, 0.3, 0.4])
    assert [condition.until_ns - 1 * S for condition in told] == [1 * MS, 2 * MS, 3 * MS, 4 * MS, 97 * MS]
    assert {condition.changes for condition in told} == {(_change(loss=BERNOULLI),)}
    down = [conditions.at(1 * S + (96 + i) * MS).scale_delay for i in range(5)]
    assert down == [3.0, 2.5, 2.0, 1.5, 1.0]
    assert conditions.spans(2 * S) == [
        Span(0, 1 * S, None, False, False),
        Span(1 * S, 1100 * MS, None, False, True),
        Span(1100 * MS, 2 * S, None, False, False),
    ]


CHANGES: list[dict[str, Any]] = [
    {"outage": True},
    {"stall": True, "scale_rate": 0.2},
    {"scale_rate": 3.0, "rate": {"kbit_s": 9}},
    {"delay": CONSTANT},
    {"delay": {"kind": "constant", "delay_ms": 9}, "jitter": NORMAL},
    {"loss": BERNOULLI, "ordering": "drop_late"},
    {"scale_delay": 2.5},
    {"add_delay_ms": 7.0, "add_p_loss": 0.25},
    {"add_p_loss": 1.0, "duplicate": {"p_duplicate": 0.5}},
    {"ordering": "reorder", "reorder": {"p_reorder": 0.1}},
    {"clean": True},
    {"clean": True, "loss": {"kind": "bernoulli", "p_loss": 0.9}, "scale_delay": 0.5},
]
STAGES = ("loss", "duplicate", "corrupt", "rate", "delay", "jitter", "correlation", "reorder", "ordering")
N_CELLS = 120

Spec = tuple[int, int, int, str, dict[str, Any]]
SPECS = st.lists(
    st.tuples(
        st.integers(0, 100),
        st.integers(1, 60),
        st.integers(0, 10),
        st.sampled_from(["forward", "feedback", "both"]),
        st.sampled_from(CHANGES),
    ),
    max_size=5,
)
NETWORK: dict[str, Any] = {
    "outages": [
        {"kind": "poisson", "mean_gap_s": 0.03, "mean_s": 0.01, "direction": "feedback"},
        {"kind": "alternating", "down": {"low_s": 0, "high_s": 0.01}, "up": {"low_s": 0.02, "high_s": 0.05}},
        {"kind": "periodic", "every_s": 0.04, "for_s": 0.01, "effect": "stall"},
    ],
    "states": {
        "kind": "markov",
        "states": [
            {"name": "good", "mean_s": 0.03, "next": [{"to": "bad"}]},
            {
                "name": "bad", "mean_s": 0.015, "next": [{"to": "good"}],
                "forward": {"delay": CONSTANT, "scale_delay": 4}, "feedback": {"outage": True, "add_delay_ms": 1},
            },
        ],
    },
}  # fmt: skip


def _written(spec: Spec) -> TimelineEntry:
    begin, length, ramp, direction, change = spec
    return _entry(begin / 1000, length / 1000, direction, ramp_s=min(ramp, length // 2) / 1000, **change)


@cache
def _rest(direction: Direction) -> list[tuple[bool, bool, str | None]]:
    """Return whether an outage and a stall hold, and the state, in each cell of `NETWORK`."""
    network = NetworkPart.model_validate(NETWORK)
    assert network.states is not None
    path, processes = StatePath.of(network.states, 1), outages_of(network.outages, direction, 1)
    *losing, stalling = processes
    return [
        (
            any(is_out(process, cell * MS) for process in losing),
            is_out(stalling, cell * MS),
            state_at(path, cell * MS)[0],
        )
        for cell in range(N_CELLS)
    ]


def _expected(network: NetworkPart, specs: list[Spec], direction: Direction, cell: int) -> tuple[Any, ...]:
    """Return what holds in a cell by the definitions, each part by itself."""
    outage, stall, name = _rest(direction)[cell] if network.states else (False, False, None)
    holding: list[tuple[Change, float]] = []
    if network.states:
        holding += [(getattr(state, direction), 1.0) for state in network.states.states if state.name == name]
    for spec in specs:
        begin, length, ramp, way, change = spec
        ramp = min(ramp, length // 2)
        if way in (direction, "both") and begin <= cell < begin + length:
            strength = min([1.0, *([(cell - begin) / ramp, (begin + length - cell) / ramp] if ramp else [])])
            holding.append((_change(**change), strength))
    stages: dict[str, Any] = {}
    for one, _ in holding:
        if one.clean:
            stages = {"clean": True}
        stages |= {name: getattr(one, name) for name in STAGES if getattr(one, name)}
    return (
        outage or any(change.outage for change, _ in holding),
        stages,
        pytest.approx(prod(1 + strength * (change.scale_delay - 1) for change, strength in holding)),
        pytest.approx(sum(1e6 * strength * change.add_delay_ms for change, strength in holding), abs=4),
        pytest.approx(1 - prod(1 - strength * change.add_p_loss for change, strength in holding)),
        name,
        stall or any(change.stall for change, _ in holding),
        pytest.approx(prod(1 + strength * (change.scale_rate - 1) for change, strength in holding)),
    )


def _told(condition: Condition) -> tuple[Any, ...]:
    assert len(condition.changes) <= 1
    given = {name: getattr(change, name) for change in condition.changes for name in (*STAGES, "clean")}
    return (condition.outage, {name: stage for name, stage in given.items() if stage}, *condition[3:7],
            condition.stall, condition.scale_rate)  # fmt: skip


@settings(deadline=None, max_examples=60)
@given(SPECS, st.sampled_from(get_args(Direction)), st.booleans(), st.permutations(range(N_CELLS)))
def test_agrees_with_each_part_by_itself(
    specs: list[Spec], direction: Direction, with_rest: bool, order: list[int]
) -> None:
    raw = (NETWORK if with_rest else {}) | {"timeline": [_written(spec) for spec in specs]}
    network = NetworkPart.model_validate(raw)
    in_order, at_random = (Conditions.of(network, direction, 1) for _ in range(2))
    random = {cell: at_random.at(cell * MS + 123_456) for cell in order}
    for cell in range(N_CELLS):
        condition = in_order.at(cell * MS)
        assert condition == random[cell]
        assert _told(condition) == _expected(network, specs, direction, cell)
        assert condition.since_ns <= cell * MS < condition.until_ns
        assert condition.since_ns % MS == condition.until_ns % MS == 0
        last_cell = min(N_CELLS * MS, condition.until_ns) // MS
        assert all(are_alike(random[other], condition) for other in range(cell, last_cell))
    spans = at_random.spans(N_CELLS * MS)
    assert [spans[0].begin_ns, *(span.end_ns for span in spans)] == [
        *(span.begin_ns for span in spans),
        N_CELLS * MS,
    ]
    for span in spans:
        for cell in range(span.begin_ns // MS, span.end_ns // MS):
            held = random[cell]
            assert (held.state, held.outage, held.stall) == (span.state, span.outage, span.stall)


@settings(deadline=None, max_examples=60)
@given(SPECS, SPECS, st.lists(st.integers(1, 12), min_size=5, max_size=5), st.integers(0, 60))
def test_what_is_added_while_running(written: list[Spec], added: list[Spec], pauses: list[int], clear: int) -> None:
    """Additions hold as if they had been written, last, from their edge until cleared; the past stays as it was."""
    network = NetworkPart.model_validate(NETWORK | {"timeline": [_written(spec) for spec in written]})
    conditions = Conditions.of(network, "forward", 1)
    seen: dict[int, Condition] = {}
    specs = list(written)
    now = 0
    for spec, pause in zip(added, pauses, strict=False):
        for cell in range(now, now + pause):
            seen[cell] = conditions.at(cell * MS + 999_999)
        now += pause
        holds_ns = conditions.add(_written(spec), (now - 1) * MS + 999_999)
        begin = max(spec[0], now)
        assert holds_ns == begin * MS
        specs.append((begin, *spec[1:]))
    stop = now + clear
    for cell in range(now, stop):
        seen[cell] = conditions.at(cell * MS)
    assert conditions.clear_added((stop - 1) * MS) == max(1, stop) * MS
    for cell in range(N_CELLS):
        valid = specs if cell < max(1, stop) else written
        condition = conditions.at(cell * MS)
        assert _told(condition) == _expected(network, valid, "forward", cell)
        if cell in seen:
            assert are_alike(condition, seen[cell])


def test_draws_made_ahead_change_nothing() -> None:
    plain, prepared = _conditions(**NETWORK), _conditions(**NETWORK)
    for cell in range(0, 400_000, 1000):  # several chunks of draws
        prepared.prepare(cell * MS)
        assert prepared.at(cell * MS) == plain.at(cell * MS)


def test_an_answer_is_cut_short_by_what_is_added() -> None:
    conditions = _conditions()
    assert conditions.at(0).until_ns == FOREVER_NS
    entry = _entry(0, 0.5, outage=True)
    assert conditions.add(entry, 7_300_000) == 8 * MS
    assert conditions.at(7_300_001).until_ns == 8 * MS
    assert conditions.at(8 * MS) == Condition(508 * MS, True, since_ns=8 * MS)
    assert conditions.added(9 * MS) == (_entry(0.008, 0.5, outage=True),)
    assert not conditions.is_constant
    assert conditions.clear_added(9 * MS) == 10 * MS
    assert [conditions.at(ns).outage for ns in (10 * MS - 1, 10 * MS)] == [True, False]
    assert conditions.added(10 * MS) == ()


def test_one_path_of_states_and_outages_of_both_for_both_directions() -> None:
    forward, feedback = (Conditions.of(NetworkPart.model_validate(NETWORK), way, 3) for way in get_args(Direction))
    states = [(forward.at(cell * MS).state, feedback.at(cell * MS).state) for cell in range(2000)]
    assert all(one == other for one, other in states)
    assert {one for one, _ in states} == {"good", "bad"}
    out = [cell for cell in range(2000) if forward.at(cell * MS).outage]
    assert out
    assert all(feedback.at(cell * MS).outage for cell in out)


def test_outages_elsewhere_shift_nothing() -> None:
    seed_1, again, seed_2 = (_conditions(seed=seed, **NETWORK) for seed in (1, 1, 2))
    more = [*NETWORK["outages"], {"kind": "periodic", "every_s": 1, "for_s": 0.5, "first_s": 100}]
    with_more = _conditions(**(NETWORK | {"outages": more}))
    without = _conditions(outages=NETWORK["outages"])
    told = [[c.at(cell * MS).outage for cell in range(5000)] for c in (seed_1, again, with_more, without, seed_2)]
    assert told[0] == told[1] == told[2] == told[3] != told[4]


def test_merging_takes_the_later_and_keeps_the_rest() -> None:
    pipeline = Pipeline.model_validate({"loss": BERNOULLI, "delay": CONSTANT, "jitter": NORMAL})
    later = {"kind": "constant", "delay_ms": 9}
    result = merged(pipeline, [_change(delay=later, ordering="drop_late"), _change(duplicate={"p_duplicate": 1})])
    expected = {"loss": BERNOULLI, "delay": later, "jitter": NORMAL, "ordering": "drop_late"}
    assert result == Pipeline.model_validate(expected | {"duplicate": {"p_duplicate": 1}})
    both = merged(pipeline, [_change(delay=later), _change(delay=CONSTANT)])
    assert both == pipeline
    assert merged(pipeline, []) is merged(pipeline, [_change(outage=True, scale_delay=2)]) is pipeline


@pytest.mark.parametrize(
    ("pipeline", "change", "left"),
    [
        ({"delay": CONSTANT, "ordering": "drop_late"}, {"clean": True}, {}),
        ({"delay": CONSTANT, "rate": {"kbit_s": 8}}, {"clean": True, "loss": BERNOULLI}, {"loss": BERNOULLI}),
        ({}, {"jitter": NORMAL, "correlation": {"half_life_s": 1}}, {}),
        ({}, {"reorder": {"p_reorder": 0.1}, "ordering": "reorder"}, {"ordering": "reorder"}),
        (
            {"delay": CONSTANT, "correlation": {"half_life_s": 1}},
            {"delay": {"kind": "trace", "path": "a.csv"}},
            {"delay": {"kind": "trace", "path": "a.csv"}},
        ),
        (
            {"delay": CONSTANT, "reorder": {"p_reorder": 0.1}, "ordering": "reorder"},
            {"ordering": "fifo"},
            {"delay": CONSTANT},
        ),
    ],
)
def test_what_lacks_what_it_needs_is_dropped(
    pipeline: dict[str, Any], change: dict[str, Any], left: dict[str, Any]
) -> None:
    result = merged(Pipeline.model_validate(pipeline), [_change(**change)])
    assert result == Pipeline.model_validate(left)


PARTS: list[dict[str, Any]] = [
    *CHANGES,
    {"delay": {"kind": "trace", "path": "a.csv"}},
    {"correlation": {"half_life_s": 1}},
    {"jitter": NORMAL},
    {"rate": {"kbit_s": 1}},
    {"rate": "link"},
    {"corrupt": {"p_corrupt": 0.5}},
    {"ordering": "fifo"},
]
PIPELINES: list[dict[str, Any]] = [
    {},
    {"delay": CONSTANT, "jitter": NORMAL, "correlation": {"half_life_s": 1}},
    {"delay": CONSTANT, "reorder": {"p_reorder": 0.1}, "ordering": "reorder", "rate": {"kbit_s": 8}},
]


@given(st.sampled_from(PIPELINES), st.lists(st.sampled_from(PARTS), max_size=5))
def test_what_is_merged_makes_sense_by_itself(pipeline: dict[str, Any], parts: list[dict[str, Any]]) -> None:
    result = merged(Pipeline.model_validate(pipeline), [_change(**part) for part in parts])
    assert Pipeline.model_validate(result.model_dump()) == result
    folded, last = Pipeline.model_validate(pipeline), dict[str, Any]()
    for part in parts:
        if part.get("clean"):
            folded, last = Pipeline(), {}
        last |= {name: stage for name, stage in part.items() if name in STAGES}
    for name, stage in last.items():
        if getattr(result, name) is not None:
            assert getattr(result, name) == getattr(_change(**{"ordering": "reorder", name: stage}), name)
    for name in set(STAGES) - set(last):
        assert getattr(result, name) in (getattr(folded, name), None)
