from fractions import Fraction
from math import ceil, floor, log, log1p
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from tests.netem.making import state_at
from tis.common.scenario.network.conditions import MarkovStates, States
from tis.common.streams import Stream
from tis.netem.conditions.states import StatePath, state_shares

MS = 1_000_000

WIFI: dict[str, Any] = {
    "kind": "markov",
    "states": [
        {"name": "good", "mean_s": 0.02, "next": [{"to": "bad", "weight": 3}, {"to": "handover"}]},
        {"name": "bad", "mean_s": 0.005, "next": [{"to": "good"}]},
        {"name": "handover", "mean_s": 0.0025, "next": [{"to": "good"}, {"to": "bad"}]},
    ],
}
CYCLE: dict[str, Any] = {
    "kind": "cycle",
    "states": [{"name": "a", "for_s": 0.14}, {"name": "b", "for_s": 14.785}, {"name": "c", "for_s": 0.075}],
}
SCRIPT: dict[str, Any] = {
    "kind": "script",
    "states": [{"name": "a"}, {"name": "b"}],
    "steps": [{"at_s": 1, "state": "b"}, {"at_s": 1.0014, "state": "a"}, {"at_s": 2, "state": "b"}],
}


def _states(raw: dict[str, Any]) -> States:
    states: States = TypeAdapter(States).validate_python(raw)
    return states


def _path(raw: dict[str, Any], seed: int = 1) -> StatePath:
    return StatePath.of(_states(raw), seed)


def test_a_cycle_to_the_nanosecond() -> None:
    path = _path(CYCLE)
    assert state_at(path, -1) == state_at(path, 0) == ("a", 140 * MS)
    assert state_at(path, 140 * MS - 1) == ("a", 140 * MS)
    assert state_at(path, 140 * MS) == ("b", 14_925 * MS)
    assert state_at(path, 14_925 * MS) == ("c", 15_000 * MS)
    assert state_at(path, 15_000 * MS) == ("a", 15_140 * MS)
    assert state_at(path, 86_400_000 * MS) == ("a", 86_400_140 * MS)


def test_a_cycle_that_has_begun_before() -> None:
    path = _path(CYCLE | {"offset_s": 44.95})
    assert state_at(path, 0) == ("c", 50 * MS)
    assert state_at(path, 50 * MS) == ("a", 190 * MS)


@settings(deadline=None, max_examples=50)
@given(st.lists(st.integers(1000, 9000), min_size=1, max_size=5), st.integers(0, 60_000))
def test_a_cycle_agrees_with_a_table_of_cells(lengths_us: list[int], offset_us: int) -> None:
    raw = {
        "kind": "cycle",
        "offset_s": offset_us / 1e6,
        "states": [{"name": str(i), "for_s": us / 1e6} for i, us in enumerate(lengths_us)],
    }
    table: list[str] = [""] * 200
    nominal = Fraction(-offset_us, 1000)
    while nominal < 200:
        for i, us in enumerate(lengths_us):
            begin, nominal = nominal, nominal + Fraction(us, 1000)
            for cell in range(max(0, floor(begin + Fraction(1, 2))), min(200, floor(nominal + Fraction(1, 2)))):
                table[cell] = str(i)
    path = _path(raw)
    for cell, name in enumerate(table):
        assert state_at(path, cell * MS) == state_at(path, cell * MS + MS - 1)
        found, until_ns = state_at(path, cell * MS)
        assert found == name
        assert until_ns > cell * MS
        assert set(table[cell : until_ns // MS]) == {name}


def test_a_script_to_the_nanosecond() -> None:
    path = _path(SCRIPT)
    assert state_at(path, 0) == (None, 1000 * MS)
    assert state_at(path, 1000 * MS) == ("b", 1001 * MS)
    assert state_at(path, 1001 * MS) == ("a", 2000 * MS)
    name, until_ns = state_at(path, 2000 * MS)
    assert name == "b"
    assert until_ns > 10**18
    at_once = _path(SCRIPT | {"steps": [{"at_s": 0, "state": "b"}]})
    assert state_at(at_once, 0)[0] == "b"


def _walk(raw: dict[str, Any], seed: int, n_cells: int) -> list[str]:
    """Walk through the uniforms one by one."""
    stream = Stream.named(seed, "both/*/states")
    names = [state["name"] for state in raw["states"]]
    table: list[str] = []
    state = raw["states"][0]
    k = 0
    while len(table) < n_cells:
        if k:
            weights = dict.fromkeys(names, 0.0)
            for successor in state["next"]:
                weights[successor["to"]] += successor.get("weight", 1.0)
            u, below = stream.uniform(2 * k), 0.0
            for name in names:
                below += weights[name] / sum(weights.values())
                if u < below:
                    break
            state = raw["states"][names.index(name)]
        mean = state["mean_s"] * 1000
        table += [state["name"]] * max(1, ceil(log(stream.uniform(2 * k + 1)) / log1p(-1 / mean)))
        k += 1
    return table[:n_cells]


def test_a_chain_agrees_with_one_walk_in_order() -> None:
    n_cells = 60_000  # several chunks
    table = _walk(WIFI, 5, n_cells)
    path = _path(WIFI, 5)
    assert table[0] == "good"
    assert [state_at(path, cell * MS + 5)[0] for cell in range(n_cells)] == table
    shuffled = _path(WIFI, 5)
    for cell in (Stream.named(0, "order").uniforms(0, 2000) * n_cells).astype(int).tolist():
        assert state_at(shuffled, cell * MS) == state_at(path, cell * MS)
    assert [_path(WIFI, 6).at(cell).value for cell in range(300)] != [path.at(cell).value for cell in range(300)]


def _simulated(raw: dict[str, Any], seed: int, n_stays: int) -> dict[str, float]:
    path = _path(raw, seed)
    lengths = dict.fromkeys(path.names, 0)
    cell = 0
    for _ in range(n_stays):
        stay = path.at(cell)
        lengths[path.names[stay.value]] += stay.end - stay.begin
        cell = stay.end
    return {name: length / cell for name, length in lengths.items()}


def test_shares_of_a_chain_are_those_of_a_long_simulation() -> None:
    shares = state_shares(_states(WIFI))
    # stays by hand: good g, bad 3/4 g + 1/2 h, handover h = g / 4: 1 : 7/8 : 1/4
    by_hand = {"good": 20.0, "bad": 5 * 7 / 8, "handover": 2.5 / 4}
    assert shares == pytest.approx({name: part / sum(by_hand.values()) for name, part in by_hand.items()}, abs=1e-12)
    assert _simulated(WIFI, 3, 100_000) == pytest.approx(shares, rel=0.02)


def test_shares_of_a_chain_that_never_comes_back() -> None:
    raw = {
        "kind": "markov",
        "states": [
            {"name": "start", "mean_s": 1, "next": [{"to": "start"}, {"to": "dead"}, {"to": "up", "weight": 3}]},
            {"name": "dead", "mean_s": 1, "next": [{"to": "dead"}]},
            {"name": "up", "mean_s": 3, "next": [{"to": "down"}]},
            {"name": "down", "mean_s": 1, "next": [{"to": "up"}]},
            {"name": "unseen", "mean_s": 1, "next": [{"to": "up"}]},
        ],
    }
    expected = {"start": 0, "dead": 0.25, "up": 0.75 * 0.75, "down": 0.75 * 0.25, "unseen": 0}
    assert state_shares(_states(raw)) == pytest.approx(expected, abs=1e-12)
    ends_dead = sum(state_at(_path(raw, seed), 3_000_000 * MS)[0] == "dead" for seed in range(400))
    assert ends_dead / 400 == pytest.approx(0.25, abs=4 * np.sqrt(0.25 * 0.75 / 400))


def test_shares_of_a_cycle_and_of_a_script() -> None:
    assert state_shares(_states(CYCLE)) == pytest.approx({"a": 0.14 / 15, "b": 14.785 / 15, "c": 0.005}, abs=1e-12)
    assert state_shares(_states(SCRIPT)) == {"a": 0.0, "b": 1.0}
    # "a" twice, 4 ms of 9 once its edges are on the grid; counted over a superperiod
    raw = {
        "kind": "cycle",
        "offset_s": 0.0005,
        "states": [
            {"name": "a", "for_s": 0.0014}, {"name": "b", "for_s": 0.0024},
            {"name": "a", "for_s": 0.0026}, {"name": "c", "for_s": 0.0026},
        ],
    }  # fmt: skip
    counted = dict.fromkeys("abc", 0)
    path = _path(raw)
    for cell in range(900, 990):
        name = state_at(path, cell * MS)[0]
        assert name is not None
        counted[name] += 1
    assert state_shares(_states(raw)) == pytest.approx({name: n / 90 for name, n in counted.items()}, abs=1e-12)
    whole = {"kind": "cycle", "states": [{"name": "a", "for_s": 0.0014}, {"name": "b", "for_s": 0.0016}]}
    assert state_shares(_states(whole)) == pytest.approx({"a": 1 / 3, "b": 2 / 3}, abs=1e-12)


def test_one_state_is_for_ever() -> None:
    raw = {"kind": "markov", "states": [{"name": "on", "mean_s": 1, "next": [{"to": "on"}]}]}
    assert state_at(_path(raw), 0) == ("on", state_at(_path(SCRIPT), 3000 * MS)[1])
    assert state_shares(_states(raw)) == {"on": 1.0}
    assert isinstance(_states(raw), MarkovStates)


@pytest.mark.parametrize(
    "raw",
    [
        {"kind": "markov", "states": [{"name": "a", "mean_s": 1, "next": [{"to": "b"}]}]},
        {"kind": "markov", "states": [{"name": "a", "mean_s": 1, "next": []}]},
        {"kind": "cycle", "states": [{"name": "a", "for_s": 0.0004}]},
        SCRIPT | {"steps": [{"at_s": 1, "state": "a"}, {"at_s": 1.0004, "state": "b"}]},
        SCRIPT | {"steps": [{"at_s": 1, "state": "c"}]},
        SCRIPT | {"steps": [{"at_s": 2, "state": "a"}, {"at_s": 1, "state": "b"}]},
        {"kind": "cycle", "states": [{"name": "a", "for_s": 1, "forward": {"reorder": {"p_reorder": 0.1}}}]},
    ],
)
def test_what_makes_no_sense_is_refused(raw: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        _states(raw)
