"""A synthetic population: whose draws are whose, and how far people differ between and within."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.scenario.source import SyntheticSource
from tis.common.sources.calibration import movement_statistics
from tis.common.sources.population import RECORDED_BETWEEN, SPREAD, person, population, trial_seed
from tis.common.sources.trajectory import Array, Recording

SOURCE = SyntheticSource(kind="synthetic", hands=("left", "right"), recorder_hz=51.33)
SEEDS = st.integers(0, 2**32)


def fields(of: SyntheticSource) -> list[float]:
    return [getattr(of, name) for name in SPREAD]


def tips(recording: Recording) -> list[Array]:
    return [hand.follower.position_m for hand in recording.hands]


def test_the_first_people_of_seed_1_are_these() -> None:
    assert [fields(person(SOURCE, 1, index)) for index in (0, 1)] == [
        [0.7517, 8.354, 0.09541, 0.03161, 7.461, 0.8493, 3.651],
        [0.6423, 19.34, 0.0971, 0.02545, 7.697, 0.8114, 2.128],
    ]


def test_over_many_people_each_field_has_its_median_and_spread() -> None:
    people = np.log([fields(person(SOURCE, 3, index)) for index in range(400)])
    for column, name in enumerate(SPREAD):
        drawn = people[:, column] - np.log(getattr(SOURCE, name))
        assert np.median(drawn) == pytest.approx(0.0, abs=0.16 * SPREAD[name])
        assert drawn.std() == pytest.approx(SPREAD[name], rel=0.12)
        assert np.abs(drawn).max() < 2.51 * SPREAD[name]
    # what one field is says nothing about another
    assert np.abs(np.corrcoef(people.T) - np.eye(len(SPREAD))).max() < 0.2


@settings(max_examples=40, deadline=None)
@given(
    seed=SEEDS,
    index=st.integers(0, 998),
    movement_s=st.floats(0.05, 60),
    pause_s=st.floats(0, 60),
    reach_mm=st.floats(0.1, 1000),
    tremor_hz=st.floats(0.1, 14),
    gripper_hold_s=st.floats(0.1, 600),
)
def test_whoever_is_drawn_about_a_valid_source_is_valid(
    seed: int,
    index: int,
    movement_s: float,
    pause_s: float,
    reach_mm: float,
    tremor_hz: float,
    gripper_hold_s: float,
) -> None:
    given_fields = {"movement_s": movement_s, "pause_s": pause_s, "reach_mm": reach_mm}
    given_fields |= {"tremor_hz": tremor_hz, "gripper_hold_s": gripper_hold_s}
    source = SyntheticSource.model_validate({"kind": "synthetic", **given_fields})
    one = person(source, seed, index)
    assert SyntheticSource.model_validate(one.model_dump()) == one == person(source, seed, index)
    untouched = set(SyntheticSource.model_fields) - set(SPREAD)
    assert all(getattr(one, name) == getattr(source, name) for name in untouched)
    assert (one.pause_s == 0) == (pause_s == 0)


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS, index=st.integers(0, 998), other=st.integers(0, 998))
def test_no_two_people_are_alike(seed: int, index: int, other: int) -> None:
    alike = np.equal(fields(person(SOURCE, seed, index)), fields(person(SOURCE, seed, other)))
    assert alike.all() if index == other else not alike.all()


TRIALS = st.tuples(SEEDS, st.integers(0, 998), st.integers(1, 999))


@given(one=TRIALS, other=TRIALS)
def test_no_two_trials_share_a_seed(one: tuple[int, int, int], other: tuple[int, int, int]) -> None:
    assert (trial_seed(*one) == trial_seed(*other)) == (one == other)


def test_the_seed_of_a_trial_can_be_read() -> None:
    assert trial_seed(7, 0, 1) == 7_001_001
    assert trial_seed(7, 11, 23) == 7_012_023
    for index, trial in ((999, 1), (-1, 1), (0, 0), (0, 1000)):
        with pytest.raises(ValueError, match="from 0 to 998"):
            trial_seed(7, index, trial)


@settings(max_examples=5, deadline=None)
@given(seed=SEEDS)
def test_a_larger_population_begins_with_the_smaller_one(seed: int) -> None:
    small = list(population(SOURCE, seed, 1, 2, 30, 60))
    large = list(population(SOURCE, seed, 3, 2, 30, 90))
    assert [each.label for each in large[:2]] == [each.label for each in small]
    assert [each.digest for each in large[:2]] == [each.digest for each in small]
    assert len({each.digest for each in large}) == 6
    assert small[1].label == f"synthetic person 1 of seed {seed}, trial 2"
    for mine, theirs in zip(small, large, strict=False):
        for one, other in zip(tips(mine), tips(theirs), strict=True):
            assert np.array_equal(one, other[:60])
    # nobody repeats a movement of another, nor of an earlier trial, nor of the other hand
    moved = [tip[:60] - tip[0] for each in large for tip in tips(each)]
    for i, one in enumerate(moved):
        for other in moved[:i]:
            assert np.abs(one - other).max() > 1e-5


def test_people_differ_more_than_their_trials_and_as_recorded_people_do() -> None:
    n_people, n_trials = 60, 2
    by_trial = []
    for recording in population(SOURCE, 1, n_people, n_trials, 30, 2700):
        of_arms = [movement_statistics(tip, 30) for tip in tips(recording)]
        by_trial.append([np.log(np.mean([arm[name] for arm in of_arms])) for name in RECORDED_BETWEEN])
    found = np.reshape(by_trial, (n_people, n_trials, len(RECORDED_BETWEEN)))
    within = found.var(axis=1, ddof=1).mean(axis=0)
    between = np.sqrt(found.mean(axis=1).var(axis=0, ddof=1) - within / n_trials)
    for name, spread, deviation in zip(RECORDED_BETWEEN, between, np.sqrt(within), strict=True):
        assert 0.57 < spread / RECORDED_BETWEEN[name] < 1.75, name
        # of recorded people, too, the spectrum alone differs more from trial to trial
        assert spread > 1.2 * deviation or name == "velocity power up to 1 Hz, share"
