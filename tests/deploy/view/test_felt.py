"""How the loop of a hand is judged while the run lasts."""

from math import pi, sin

import pytest

from tis.common.scenario.control import DirectionState, EmulatorState
from tis.common.scenario.network.conditions import TimelineEntry
from tis.common.scenario.network.pipeline import Pipeline
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.deploy.view.felt import NetworkEdges, loop_verdict, told
from tis.deploy.watch.forces import FeltRow


def _rows(growth: float, size_mm: float = 0.01, n: int = 1500, meant_mm: float = 1.0) -> list[FeltRow]:
    """A hand that intends to move slowly, and swings at 4 Hz about that, ``growth`` times wider in each second."""
    rows = []
    for k in range(n):
        meant_m = 0.001 * meant_mm * sin(0.06 * k)
        off_m = 0.001 * size_mm * growth ** (k / 100) * sin(2.0 * pi * 0.04 * k)
        places = ((0.0, 0.0, meant_m + off_m), (0.0, 0.0, meant_m))
        rows.append(FeltRow(k * 10 * NS_PER_MS, (0.0, 0.0, 1.0), None, None, "", *places, 0.0, 0.0))
    return rows


def _state(rows: list[FeltRow], changed_s: float = 0.0) -> str | None:
    found = loop_verdict(rows, round(changed_s * NS_PER_S))
    return None if found is None else found.stability


def test_the_loop_is_judged_as_the_report_does_and_not_where_no_intention_is_told() -> None:
    assert _state([]) is None
    assert _state(_rows(2.5, n=1000)) == "unstable"
    assert _state(_rows(0.5, n=1000)) == "stable"
    told_none = [row._replace(position_m=row.intended_m) for row in _rows(2.0, n=1000)]
    assert _state(told_none) == "not_decidable"


def test_what_was_before_a_change_of_the_network_is_of_another_loop() -> None:
    """It swung ever wider for 10 s; since the change it rests."""
    rests = [row._replace(t_ns=row.t_ns + 10 * NS_PER_S) for row in _rows(0.5, n=700)]
    rows = [*_rows(2.5, n=1000), *rests]
    assert _state(rows[:1020]) == "unstable"
    assert _state(rows, changed_s=10.0) == "stable"
    assert _state(rows[:1300], changed_s=10.0) == "not_yet"
    assert _state(rows[:1001], changed_s=10.0) is None
    young = loop_verdict(rows[:1300], 10 * NS_PER_S)
    assert young is not None
    assert told(young)["over_s"] == 3.0


@pytest.mark.parametrize("growth", [2.5, 1.0, 0.5])
def test_of_a_hand_at_rest_to_a_micrometre_nothing_is_told(growth: float) -> None:
    """Its swing is the rounding's: growing, it would be told as one that nobody can see."""
    rows = [
        row._replace(position_m=(0.0, 0.0, row.position_m[2] + 0.003))
        for row in _rows(growth, size_mm=1e-8, n=1000, meant_mm=0.0)
    ]
    found = loop_verdict(rows, 0)
    assert found is not None
    assert (found.stability, found.swing, found.stands) == ("not_decidable", None, "still")
    free = loop_verdict([row._replace(hand_n=(0.0, 0.0, 0.0)) for row in rows], 0)
    assert free is not None
    assert (free.stability, free.stands) == ("not_decidable", "free")


def _after(rows: list[FeltRow], more: list[FeltRow]) -> list[FeltRow]:
    begin_ns = rows[-1].t_ns + 10 * NS_PER_MS
    return [*rows, *(row._replace(t_ns=begin_ns + row.t_ns) for row in more)]


def test_of_a_hand_that_has_left_what_it_touched_nothing_is_told() -> None:
    """Its way off the wall is fast, beside which the swing of before looked small."""
    lifts = [
        row._replace(intended_m=(0.0, 0.0, 1e-3 * k), position_m=(0.0, 0.0, 1e-3 * k), hand_n=(0.0, 0.0, 0.0))
        for k, row in enumerate(_rows(1.0, n=600))
    ]
    rows = _after(_rows(1.6, n=900), lifts)
    found = loop_verdict(rows, 0)
    assert found is not None
    assert (found.stability, found.stands) == ("not_decidable", "free")
    # Back at the wall, what was before it left is of no account.
    again = loop_verdict(_after(rows, _rows(0.5, n=200)), 0)
    assert again is not None
    assert (again.stability, again.over_s) == ("not_yet", 2.0)


def test_the_time_before_a_hand_at_rest_moves_tells_nothing() -> None:
    """Ten seconds at rest and one of a nudge, by which the swing that follows looks small."""
    rests = [row._replace(position_m=(0.0, 0.0, 0.003)) for row in _rows(1.0, n=1000, meant_mm=0.0)]
    nudged = []
    for k, row in enumerate(_rows(1.3, size_mm=0.005, n=100, meant_mm=0.0)):
        meant_m = 5e-5 * min(k, 10)
        place_m = (0.0, 0.0, 0.003 + meant_m + row.position_m[2])
        nudged.append(row._replace(intended_m=(0.0, 0.0, meant_m), position_m=place_m))
    found = loop_verdict(_after(rests, nudged), 0)
    assert found is not None
    assert (found.stability, found.over_s) == ("not_decidable", 1.0)


def test_only_the_last_15_s_are_judged() -> None:
    rows = [*_rows(2.5, n=1000), *(row._replace(t_ns=row.t_ns + 10 * NS_PER_S) for row in _rows(0.5, n=1502))]
    assert _state(rows) == "stable"


def test_a_swing_of_a_hand_at_rest_has_its_size_and_growth() -> None:
    """0.01 mm at 4 Hz, 1.3 times wider in each second: 0.5 mm after 14.9 s."""
    rows = _rows(1.3, n=1000, meant_mm=0.0)
    found = loop_verdict(rows, 0)
    assert found is not None
    assert found.swing is not None
    assert found.stability == "unstable"
    assert found.swing.size_mm == pytest.approx(0.01 * 1.3**9.875, rel=0.02)
    assert found.swing.growth_pct == pytest.approx(100 * (1.3**0.25 - 1), rel=0.02)
    assert found.swing.seen_in_s == pytest.approx(14.9 - 9.9, abs=0.2)
    shown = told(found)
    assert shown["swing"]["growth_pct"] == pytest.approx(6.78, abs=0.05)


def test_a_growing_swing_is_told_though_the_intention_has_moved_further_than_it() -> None:
    """A pointer that moves by one pixel, 0.13 mm, is faster than a swing of a hundredth of a millimetre."""
    rows = [
        row._replace(position_m=(1.3e-4, 0.0, row.position_m[2]), intended_m=(1.3e-4, 0.0, row.intended_m[2]))
        if k >= 500
        else row
        for k, row in enumerate(_rows(1.3, size_mm=0.0004, n=1500, meant_mm=0.0))
    ]
    found = loop_verdict(rows, 0)
    assert found is not None
    assert found.swing is not None
    assert found.swing.growth_pct == pytest.approx(100 * (1.3**0.25 - 1), rel=0.05)
    assert found.stability == "unstable"


def test_what_is_seen_already_or_does_not_grow_is_told_so() -> None:
    wide, steady = (loop_verdict(_rows(*each, meant_mm=0.0), 0) for each in ((1.3, 1.0), (1.0, 1.0)))
    assert wide is not None
    assert wide.swing is not None
    assert wide.swing.seen_in_s is None
    assert steady is not None
    assert steady.swing is not None
    assert (steady.swing.growth_pct, steady.swing.seen_in_s) == (None, None)
    for none in (_rows(1.3), _rows(1.3, size_mm=0.0, meant_mm=0.0)):  # it moves on purpose; it does not swing
        found = loop_verdict(none, 0)
        assert found is not None
        assert found.swing is None


def _asked(at_s: float, *begins_s: float, for_s: float | None = None) -> EmulatorState:
    entries = tuple(
        TimelineEntry.model_validate({"at_s": one, "set": {"outage": True}} | ({"for_s": for_s} if for_s else {}))
        for one in begins_s
    )
    way = DirectionState(
        outage=False, scale_delay=1.0, add_delay_ms=0.0, add_p_loss=0.0, pipeline=Pipeline(), now=Pipeline(),
        rules=(), added=entries, counters={},
    )  # fmt: skip
    return EmulatorState(running=True, at_s=at_s, forward=way, feedback=way)


def test_the_network_changes_where_what_was_asked_for_begins_and_ends() -> None:
    edges, found = NetworkEdges(), []
    states = (_asked(1), _asked(2, 1.9), _asked(3, 1.9, 9.0), _asked(8, 1.9, 9.0), _asked(9.2, 1.9, 9.0), _asked(12))
    for state in states:
        assert state.at_s is not None
        edges.note(state, round(state.at_s * NS_PER_S))
        found.append(edges.changed_ns / NS_PER_S)
    assert found == [0.0, 2.0, 2.0, 2.0, 9.2, 12.0]  # what is still to come changes nothing yet


def test_a_page_that_comes_later_learns_of_the_change_before() -> None:
    edges = NetworkEdges()
    edges.note(None, 40 * NS_PER_S)
    edges.note(_asked(40, 12.5, 30.25, 77.0), 40 * NS_PER_S)
    assert edges.changed_ns == 30.25 * NS_PER_S
