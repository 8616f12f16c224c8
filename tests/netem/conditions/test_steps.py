"""A delay in steps: one value for each period, the same in any order of access and in both directions."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.common.scenario.network import NetworkPart
from tis.netem.conditions.conditions import Conditions
from tis.netem.conditions.steps import levels_ms
from tis.netem.expected.figures import direction_figures
from tis.netem.expected.simulate import simulate
from tis.netem.expected.synopsis import synopsis

MS = 1_000_000
UNIFORM = {"kind": "uniform", "low_ms": 10, "high_ms": 30}


def network(*steps: dict[str, Any], **more: Any) -> NetworkPart:
    return NetworkPart.model_validate({"steps": [{"delay": UNIFORM, **one} for one in steps], **more})


def added_ns(of: NetworkPart, direction: Any, cells: list[int]) -> list[int]:
    conditions = Conditions.of(of, direction, 5)
    return [conditions.at(cell * MS).add_delay_ns for cell in cells]


@given(st.floats(0.001, 0.05), st.one_of(st.none(), st.floats(0, 0.02)), st.lists(st.integers(0, 300), min_size=1))
def test_a_value_holds_from_edge_to_edge_whatever_was_asked_before(
    every_s: float, first_s: float | None, cells: list[int]
) -> None:
    of = network({"every_s": every_s, "first_s": first_s})
    all_cells = added_ns(of, "forward", list(range(301)))
    assert added_ns(of, "forward", cells) == [all_cells[cell] for cell in cells]
    edges = [k for k in range(1, 301) if all_cells[k] != all_cells[k - 1]]
    begin_s = every_s if first_s is None else first_s
    nominal = {int((begin_s + k * every_s) * 1000 + 0.5 + shift) for k in range(301) for shift in (-1e-6, 1e-6)}
    assert set(edges) <= nominal
    assert all(10 * MS <= value <= 30 * MS for value in all_cells)


def test_both_directions_have_the_same_steps_and_one_alone_leaves_the_other() -> None:
    cells = list(range(0, 100, 5))
    both, alone = network({"every_s": 0.01}), network({"every_s": 0.01, "direction": "feedback"})
    assert added_ns(both, "forward", cells) == added_ns(both, "feedback", cells)
    assert set(added_ns(alone, "forward", cells)) == {0}
    assert len(set(added_ns(alone, "feedback", cells))) > 5


def test_several_add_up_with_a_state() -> None:
    cycle = {"kind": "cycle", "states": [{"name": "a", "for_s": 1, "forward": {"add_delay_ms": 7}}]}
    one, two = {"every_s": 0.01}, {"every_s": 0.015}
    cells = list(range(100))
    total = added_ns(network(one, two, states=cycle), "forward", cells)
    first = added_ns(network(one), "forward", cells)
    assert all(20 * MS + 7 * MS <= value <= 60 * MS + 7 * MS for value in total)
    assert all(value - of >= 17 * MS for value, of in zip(total, first, strict=True))


def test_the_figures_are_those_of_a_long_simulation() -> None:
    points = [{"p": 0, "delay_ms": 0}, {"p": 0.5, "delay_ms": 20}, {"p": 1, "delay_ms": 60}]
    of = network(
        {"every_s": 0.5}, {"every_s": 0.3, "delay": {"kind": "quantiles", "points": points}},
        forward={"delay": {"kind": "normal", "mean_ms": 50, "std_ms": 2}, "ordering": "reorder"},
    )  # fmt: skip
    delay_ms = simulate(of, "forward", 1, np.arange(200_000) * 10 * MS).delay_ns / MS
    figures = direction_figures(of, "forward")
    assert figures.mean_ms == pytest.approx(delay_ms.mean(), rel=0.01)
    assert figures.std_ms == pytest.approx(delay_ms.std(), rel=0.03)
    assert figures.p99_ms == pytest.approx(np.quantile(delay_ms, 0.99), rel=0.03)
    assert synopsis(of, {})[0].endswith("steps every 0.5 s, steps every 0.3 s")
    assert levels_ms(of.steps, "forward").mean() == pytest.approx(20 + 25, rel=0.02)
