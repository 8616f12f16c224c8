"""Motion of a set point: exact within its bounds, bounded beyond them, and at rest in the end."""

from math import dist, sqrt

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from patient_side.safety.set_point import STILL, Bounds, Place, brake, follow, minus, within

_COORDINATE = st.floats(-1.0, 1.0)
_PLACE = st.tuples(_COORDINATE, _COORDINATE, _COORDINATE)
_BOUNDS = st.builds(Bounds, st.floats(1e-6, 0.1), st.floats(1e-7, 0.1))


def test_a_target_within_the_bounds_is_reached_bit_for_bit() -> None:
    assert follow((0.1, 0.2, 0.3), STILL, (0.1001, 0.2, 0.3), Bounds(0.008, 0.01)) == (0.1001, 0.2, 0.3)


def test_a_far_target_is_approached_by_one_step_and_then_met() -> None:
    place, step, target, seen = (0.0, 0.0, 0.0), STILL, (0.020, 0.0, 0.0), []
    for _ in range(4):
        new = follow(place, step, target, Bounds(0.008, 0.011))
        place, step = new, minus(new, place)
        seen.append(round(place[0], 9))
    assert seen == [0.008, 0.016, 0.020, 0.020]


def test_a_bound_of_the_change_makes_it_speed_up_and_slow_down_again() -> None:
    place, step, steps = STILL, STILL, []
    for _ in range(200):
        new = follow(place, step, (0.1, 0.0, 0.0), Bounds(0.002, 0.0001))
        place, step = new, minus(new, place)
        steps.append(step[0])
    assert place == (0.1, 0.0, 0.0)
    assert max(steps) == pytest.approx(0.002)
    assert all(abs(b - a) <= 0.0001 + 1e-12 for a, b in zip([0.0, *steps], steps, strict=False))


def test_the_way_takes_little_longer_than_the_time_optimal_one() -> None:
    """The time-optimal way from rest to rest: a triangle of speed, 2 sqrt(d / a) ticks."""
    distance_m, change_m = 0.05, 1e-5
    place, step, n_ticks = STILL, STILL, 0
    while place != (distance_m, 0.0, 0.0):
        new = follow(place, step, (distance_m, 0.0, 0.0), Bounds(1.0, change_m))
        place, step, n_ticks = new, minus(new, place), n_ticks + 1
    assert n_ticks <= 1.1 * 2 * sqrt(distance_m / change_m)


@given(_PLACE, _PLACE, _PLACE, _BOUNDS)
def test_no_step_is_longer_and_turns_more_than_allowed(
    place: Place, target: Place, last: Place, bounds: Bounds
) -> None:
    last_step = minus(last, STILL)
    step = minus(follow(place, last_step, target, bounds), place)
    assert dist(step, STILL) <= max(bounds.step_m, dist(last_step, STILL) - bounds.change_m) + 1e-9
    # a shortened step may turn a little more: it is the bound of the speed that shortens it
    if dist(last_step, STILL) <= bounds.step_m:
        assert dist(step, last_step) <= bounds.change_m + 1e-9


@settings(max_examples=50)
@given(_PLACE, st.floats(0.0005, 0.01), st.floats(0.0001, 0.01))
def test_a_resting_target_is_met_in_the_end(target: Place, step_m: float, change_m: float) -> None:
    place, step = STILL, STILL
    for _ in range(20_000):
        new = follow(place, step, target, Bounds(step_m, change_m))
        place, step = new, minus(new, place)
        if place == target and step == STILL:
            return
    raise AssertionError((place, target))


@given(_PLACE, _BOUNDS)
def test_braking_shortens_each_step_down_to_rest(last: Place, bounds: Bounds) -> None:
    step = minus(brake(STILL, last, bounds), STILL)
    assert dist(step, STILL) == pytest.approx(max(0.0, dist(last, STILL) - bounds.change_m), abs=1e-12)


@given(_PLACE, _PLACE, _PLACE, st.floats(0.01, 2.0))
def test_a_sphere_holds_every_place_and_brings_no_two_apart(
    one: Place, two: Place, centre: Place, radius_m: float
) -> None:
    a, b = within(one, centre, radius_m), within(two, centre, radius_m)
    assert dist(a, centre) <= radius_m + 1e-12
    assert dist(a, b) <= dist(one, two) + 1e-12
    if dist(one, centre) <= radius_m:
        assert a == one
