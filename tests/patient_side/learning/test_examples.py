import numpy as np
import pytest

from tests.patient_side.learning.tracks import SPREAD_RAD, USUAL_M, linear, some_examples, turning
from tis.common.errors import DataError
from tis.common.streams import Stream
from tis.patient_side.learned.gaussian_process import AGES
from tis.patient_side.learned.inputs import N_LAGS, activity_of, window_before
from tis.patient_side.learning.examples import (
    EVERY,
    FIRST_ROW,
    N_AGES,
    TICK_PHASE,
    Examples,
    draw_arrivals,
    examples_of,
)
from tis.patient_side.playout import Playout

RATE_HZ = 30


def test_an_example_is_what_a_patient_would_see_and_what_the_filter_leaves() -> None:
    track = turning(3, n=300)
    found = examples_of([track], linear(), USUAL_M, SPREAD_RAD, 1, 3)
    # The third pass is of the third kind of network, bursts; its examples are the last ones.
    arrival = draw_arrivals(2, 300, Stream.named(1, "learning/arrivals/2"))
    estimator, playout = linear(), Playout(RATE_HZ)
    state, seen = estimator.initial(), []
    for k in range(299):
        tick = k + TICK_PHASE
        for i in np.flatnonzero((arrival <= tick) & (arrival > tick - 1)).tolist():
            playout.arm.add(i, track.position_m[i], float(track.gripper_rad[i]))
        if playout.arm.newest < 0:
            continue
        instant_ns = round(tick * 1e9 / RATE_HZ)
        state, estimate = estimator.step(state, playout, instant_ns)
        newest = playout.arm.newest
        window = window_before(newest, 1, playout.arm.get, playout.arm.gripper_rad)
        seen.append((k, newest, window, estimate, state.ring[-1].activity[0]))
    of_pass = found.rows(np.arange(len(found) - 20, len(found)))
    # The examples' last ticks are those whose drawn ages end within the rows; find them by the age at the tick.
    matched = 0
    for i in range(len(of_pass)):
        for k, newest, window, estimate, pace in seen[FIRST_ROW:]:
            activity = activity_of(window, USUAL_M)
            same = abs(of_pass.ages[i, 0] - (k + TICK_PHASE - newest)) < 1e-9
            way = window.way_m[0] / (USUAL_M * activity[0])
            if not same or not np.allclose(of_pass.window.way[i], way, atol=1e-3):
                continue
            assert estimate.position_m is not None
            assert estimate.covariance_m2 is not None
            unit_m = np.sqrt(np.trace(estimate.covariance_m2) / 3 / pace) * activity[0]
            assert of_pass.unit_m[i, 0] == pytest.approx(unit_m, rel=1e-6)
            x = k + TICK_PHASE
            truth = [np.interp(x, np.arange(300), track.position_m[:, a]) for a in range(3)]
            np.testing.assert_allclose(
                of_pass.left[i, 0] * unit_m, truth - estimate.position_m, atol=1e-6 * np.ptp(track.position_m)
            )
            matched += 1
            break
    assert matched == len(of_pass)


def test_rows_shorter_than_the_furthest_forecast_are_refused_in_words() -> None:
    rule = r"training rows: the longest stretch: must be longer than the furthest forecast.*5\.0 s \(got '5\.0 s'\)"
    with pytest.raises(DataError, match=rule):
        examples_of([turning(3, n=150), turning(3, n=90)], linear(), USUAL_M, SPREAD_RAD, 1, 1, AGES)
    assert len(examples_of([turning(3, n=300)], linear(), USUAL_M, SPREAD_RAD, 1, 1, AGES)) > 0


def test_examples_have_a_forecast_to_the_tick_and_three_over_drawn_ages() -> None:
    found = some_examples()
    assert found.ages.shape == (len(found), N_AGES)
    assert found.window.way.shape == (len(found), N_LAGS, 3)
    assert found.ages.min() >= TICK_PHASE - 1e-9
    assert found.ages.max() <= 150.0
    assert np.isfinite(found.left).all()
    assert found.names == ("A", "B")
    assert set(found.groups.tolist()) == {0, 1}


def test_what_has_not_arrived_does_not_change_an_example() -> None:
    track = turning(3, n=300)
    moved = track._replace(
        position_m=np.where(np.arange(300)[:, None] > 250, 9.0, track.position_m),
        gripper_rad=np.where(np.arange(300) > 250, 9.0, track.gripper_rad),
    )
    ages = np.array([1.0])  # none reaches far
    pairs = [examples_of([each], linear(), USUAL_M, SPREAD_RAD, 1, 1, ages) for each in (track, moved)]

    def before(examples: Examples) -> Examples:
        return examples.rows(np.arange((250 - FIRST_ROW) // EVERY - 1))

    for ours, theirs in zip(before(pairs[0]).window, before(pairs[1]).window, strict=True):
        assert np.array_equal(ours, theirs)
    assert np.array_equal(before(pairs[0]).moves, before(pairs[1]).moves)


def test_the_same_seed_gives_the_same_examples_and_another_one_others() -> None:
    one, again, other = some_examples(seed=1), some_examples(seed=1), some_examples(seed=2)
    assert np.array_equal(one.left, again.left)
    assert len(one) != len(other) or not np.array_equal(one.left, other.left)


def test_examples_can_have_given_ages() -> None:
    ages = np.array([1.0, 6.0])
    found = examples_of([turning(0)], linear(), USUAL_M, SPREAD_RAD, 1, 1, ages)
    assert np.array_equal(found.ages, np.tile(ages, (len(found), 1)))
