"""Motion of a set point: exact within its bounds, bounded beyond them, and at rest in the end."""

from collections.abc import Iterator
from itertools import pairwise
from math import dist, sqrt

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.vector import minus, plus
from tis.patient_side.safety.set_point import (
    AT_REST,
    NO_CORRECTION,
    STILL,
    Motion,
    Pace,
    Place,
    brake,
    follow,
    run_out,
    within,
)

_COORDINATE = st.floats(-1.0, 1.0)
_PLACE = st.tuples(_COORDINATE, _COORDINATE, _COORDINATE)
_CHANGE = st.floats(1e-7, 0.1)
_STEP = st.floats(1e-6, 0.1)
_FEW_MM = 0.005


def _pace(step: float, change: float) -> Pace:
    return Pace(step, change, change)


def _way_to(
    target: Place, pace: Pace, most_corrected: float = NO_CORRECTION, motion: Motion = AT_REST, n: int = 100_000
) -> Iterator[tuple[Place, Motion]]:
    """Yield places and motions on the way from the origin to a target that stays, a tick each ms, until it rests."""
    place = STILL
    for k in range(n):
        moved = follow(minus(target, place), motion, pace, most_corrected, k * 1_000_000)
        place, motion = target if moved.meets else plus(place, moved.by), moved.motion
        yield place, motion
        if place == target and motion.carried == STILL:
            return


def _from_segment(point: Place, end: Place) -> float:
    square = sum(part * part for part in end)
    share = 0.0 if square == 0.0 else sum(a * b for a, b in zip(point, end, strict=True)) / square
    share = min(max(share, 0.0), 1.0)
    return dist(point, (share * end[0], share * end[1], share * end[2]))


def test_a_target_within_the_bounds_is_met_bit_for_bit() -> None:
    moved = follow((0.0001, 0.0, 0.0), AT_REST, _pace(0.008, 0.01), NO_CORRECTION, 0)
    assert (moved.by, moved.meets, moved.motion) == ((0.0001, 0.0, 0.0), True, Motion((0.0001, 0.0, 0.0), True))


def test_a_far_target_is_approached_by_one_step_and_then_met() -> None:
    seen = [round(place[0], 9) for place, _ in _way_to((0.020, 0.0, 0.0), _pace(0.008, 0.011))]
    assert seen == [0.008, 0.016, 0.020, 0.020]


@pytest.mark.parametrize("size_mm", [0.5, 2.0, 5.0])
def test_a_correction_is_spent_at_once_and_leaves_nothing_to_brake(size_mm: float) -> None:
    """At 1 kHz 200 m/s^2 are 0.2 mm a tick: what is more is a correction."""
    target = (size_mm / 1000, 0.0, 0.0)
    places = [place for place, _ in _way_to(target, _pace(0.0018, 0.0002), _FEW_MM, Motion(has_met=True))]
    assert set(places) == {target}


def test_corrections_within_33_ms_add_up_to_no_more_than_allowed() -> None:
    place, motion, target, spent = STILL, Motion(has_met=True), 0.0, []
    for k in range(400):
        target += 0.002 if k % 5 == 0 else 0.0
        before = place
        moved = follow((target - place[0], 0.0, 0.0), motion, _pace(0.0018, 0.0002), _FEW_MM, k * 1_000_000)
        place, motion = (target, 0.0, 0.0) if moved.meets else plus(place, moved.by), moved.motion
        spent.append(dist(place, plus(before, motion.carried)))
    windows = [sum(spent[k : k + 33]) for k in range(len(spent) - 33)]
    assert 0.004 < max(windows) <= 0.005 + 1e-12


def test_a_bound_of_the_change_makes_it_speed_up_and_slow_down_again() -> None:
    steps = [motion.carried[0] for _, motion in _way_to((0.1, 0.0, 0.0), _pace(0.002, 0.0001))]
    assert max(steps) == pytest.approx(0.002)
    assert all(abs(b - a) <= 0.0001 + 1e-12 for a, b in pairwise([0.0, *steps]))


def test_the_way_takes_little_longer_than_the_time_optimal_one() -> None:
    """The time-optimal way from rest to rest: a triangle of speed, 2 sqrt(d / a) ticks."""
    distance_m, change_m = 0.05, 1e-5
    n_ticks = len([*_way_to((distance_m, 0.0, 0.0), _pace(1.0, change_m))])
    assert n_ticks <= 1.05 * 2 * sqrt(distance_m / change_m)


@settings(max_examples=150)
@given(_PLACE, _PLACE, _STEP, _CHANGE, st.sampled_from([0.0, 1e-3, 0.005]), st.booleans())
def test_a_target_that_stays_is_overshot_by_no_more_than_the_carried_step_needs(
    target: Place, direction: Place, step: float, change: float, most: float, has_met: bool
) -> None:
    size = dist(direction, STILL) or 1.0
    carried = tuple(step * part / size for part in direction)
    motion = Motion(carried, has_met)  # type: ignore[arg-type]
    length = dist(motion.carried, STILL)
    bound = length * length / (2 * change) + length + 1e-9
    for place, _ in _way_to(target, _pace(step, change), most, motion, 300):
        assert _from_segment(place, target) <= bound


@settings(max_examples=50)
@given(_PLACE, st.floats(0.0005, 0.01), st.floats(0.0001, 0.01))
def test_from_rest_a_resting_target_is_met_without_overshoot(target: Place, step_m: float, change_m: float) -> None:
    places = [place for place, _ in _way_to(target, _pace(step_m, change_m), _FEW_MM)]
    assert places[-1] == target
    assert max(_from_segment(place, target) for place in places) <= 1e-12
    ways = [dist(place, target) for place in places]
    assert all(after <= before + 1e-12 for before, after in pairwise(ways))


@given(_PLACE, _PLACE, _STEP, _CHANGE)
def test_a_carried_step_is_no_longer_and_changes_no_more_than_allowed(
    place: Place, last: Place, step: float, change: float
) -> None:
    length = dist(last, STILL)
    carried = last if length <= step else tuple(step * part / length for part in last)
    for most in (NO_CORRECTION, 10.0):
        for has_met in (True, False):
            moved = follow(place, Motion(carried, has_met), _pace(step, change), most, 0)  # type: ignore[arg-type]
            assert dist(moved.motion.carried, STILL) <= step + 1e-9
            assert dist(moved.motion.carried, carried) <= change + 1e-9


@given(_PLACE, _CHANGE)
def test_braking_ends_after_the_way_of_its_speed(last: Place, change: float) -> None:
    motion, way, n = Motion(last, True), 0.0, 0
    while motion.carried != STILL and n < 10_000:
        moved = brake(motion, change)
        assert dist(moved.by, STILL) == pytest.approx(max(0.0, dist(motion.carried, STILL) - change), abs=1e-12)
        motion, way, n = moved.motion, way + dist(moved.by, STILL), n + 1
    length = dist(last, STILL)
    if motion.carried == STILL:
        assert way == pytest.approx(run_out(length, change), abs=1e-9 + 1e-6 * length)
        assert way <= length * length / (2 * change) + 1e-12


@given(_PLACE, _PLACE, _PLACE, st.floats(0.01, 2.0))
def test_a_sphere_holds_every_place_and_brings_no_two_apart(
    one: Place, two: Place, centre: Place, radius_m: float
) -> None:
    a, b = within(one, centre, radius_m), within(two, centre, radius_m)
    assert dist(a, centre) <= radius_m + 1e-12
    assert dist(a, b) <= dist(one, two) + 1e-12
    if dist(one, centre) <= radius_m:
        assert a == one
