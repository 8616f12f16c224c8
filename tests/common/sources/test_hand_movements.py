import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.scenario.source import SyntheticSource
from tis.common.sources.hand_movements import Movements, minimum_jerk, reaching, timing_of, turning
from tis.common.sources.synthetic import synthesise
from tis.common.sources.trajectory import Array
from tis.common.streams import Stream


def test_the_polynomial_solves_the_boundary_value_problem() -> None:
    # the Euler-Lagrange equation of minimum jerk is x'''''' = 0: a quintic with rest at both ends
    def derivatives(p: float) -> list[list[float]]:
        powers = range(6)
        return [
            [p**k for k in powers],
            [k * p ** max(k - 1, 0) for k in powers],
            [k * (k - 1) * p ** max(k - 2, 0) for k in powers],
        ]

    coefficients = np.linalg.solve(np.array(derivatives(0.0) + derivatives(1.0)), [0, 0, 0, 1, 0, 0])
    phase = np.linspace(0, 1, 101)
    assert minimum_jerk(phase) == pytest.approx(np.polynomial.polynomial.polyval(phase, coefficients), abs=1e-12)


def test_no_other_smooth_path_has_less_jerk() -> None:
    phase = np.linspace(0, 1, 401)

    def jerk(path: Array) -> float:
        return float(np.sum(np.diff(path, 3) ** 2))

    best = jerk(minimum_jerk(phase))
    for k in (1, 2, 3):
        # keeps position, velocity and acceleration at both ends
        bump = (phase * (1 - phase)) ** 3 * np.cos(k * np.pi * phase)
        for size in (-1.0, 1.0):
            assert jerk(minimum_jerk(phase) + size * bump) > best


def test_before_and_after_a_movement_there_is_rest() -> None:
    assert minimum_jerk(np.array([-5.0, 0.0, 0.5, 1.0, 7.0])).tolist() == [0.0, 0.0, 0.5, 1.0, 1.0]


def test_a_single_movement_peaks_half_way_at_15_eighths_of_its_mean_speed() -> None:
    movement = Movements(np.array([1.0]), np.array([2.0]), np.array([[10.0], [40.0]]))
    t_s = np.arange(0, 4, 1e-4)
    position = movement.at(t_s)[:, 0]
    speed = np.diff(position) / 1e-4
    assert position[t_s <= 1.0] == pytest.approx(10.0)
    assert position[t_s >= 3.0] == pytest.approx(40.0)
    assert speed.max() == pytest.approx(15 / 8 * 30 / 2, rel=1e-6)
    assert t_s[np.argmax(speed)] == pytest.approx(2.0, abs=1e-3)


@settings(max_examples=40, deadline=None)
@given(data=st.lists(st.tuples(st.floats(0, 1), st.floats(0.05, 3), st.floats(-9, 9)), min_size=1, max_size=12))
def test_overlapping_movements_add_up(data: list[tuple[float, float, float]]) -> None:
    steps_s, durations_s, places = (np.array(values) for values in zip(*data, strict=True))
    onset_s = np.cumsum(steps_s)
    target = np.concatenate([[1.0], places])[:, np.newaxis]
    t_s = np.linspace(-1, 20, 400)
    plain = np.full(400, 1.0)
    for i, t0 in enumerate(onset_s):
        p = np.minimum(np.maximum(t_s - t0, 0) / durations_s[i], 1)
        plain += (target[i + 1, 0] - target[i, 0]) * (10 * p**3 - 15 * p**4 + 6 * p**5)
    assert Movements(onset_s, durations_s, target).at(t_s)[:, 0] == pytest.approx(plain, abs=1e-9)


PLAIN = SyntheticSource(kind="synthetic")


def sequence(share: float, seed: int = 1, until_s: float = 3000.0) -> Movements:
    timing = timing_of(PLAIN, share, Stream.named(seed, "timing"), until_s)
    return reaching(PLAIN, timing, Stream.named(seed, "aim"))


def test_lengths_and_durations_are_those_asked_for() -> None:
    moves = sequence(1.0)
    assert moves.duration_s.mean() == pytest.approx(0.7, rel=0.05)
    length_mm = np.linalg.norm(np.diff(moves.target, axis=0), axis=1)
    # what would leave the space is shortened: a little less than asked for
    assert 0.8 * 13 < np.median(length_mm) < 1.02 * 13
    assert np.abs(moves.target).max() <= 40.0
    # longer movements take longer: the slope of the logarithms
    inner = length_mm < 20
    slope = np.polyfit(np.log(length_mm[inner]), np.log(moves.duration_s[inner]), 1)[0]
    assert slope == pytest.approx(0.43, abs=0.08)


def test_sequences_whose_shares_add_up_hold_as_many_movements_as_one() -> None:
    until_s = 3000.0
    n_of = {share: int(np.sum(sequence(share).onset_s < until_s)) for share in (1.0, 0.65, 0.35)}
    for share in (0.65, 0.35):
        assert n_of[share] == pytest.approx(share * n_of[1.0], rel=0.1)


def test_timing_and_aim_are_apart() -> None:
    timing = timing_of(PLAIN, 0.5, Stream.named(1, "timing"), 100.0)
    one, other = (reaching(PLAIN, timing, Stream.named(seed, "aim")) for seed in (1, 2))
    assert np.array_equal(one.onset_s, other.onset_s)
    assert np.array_equal(one.duration_s, other.duration_s)
    assert np.linalg.norm(one.target[1:] - other.target[1:], axis=1).min() > 0


ONE_HAND = SyntheticSource(kind="synthetic", turn_deg=10.0)
TIMING = timing_of(ONE_HAND, 1.0, Stream.named(1, "timing"), 3000.0)


def test_each_reach_turns_the_hand_within_its_time_by_the_angle_asked_for() -> None:
    turns = turning(ONE_HAND, TIMING, Stream.named(1, "turn"))
    assert len(turns.onset_s) == len(TIMING.onset_s)
    assert (turns.onset_s >= TIMING.onset_s).all()
    assert (turns.onset_s + turns.duration_s <= TIMING.onset_s + TIMING.duration_s + 1e-9).all()
    angle_deg = np.degrees(np.linalg.norm(np.diff(turns.target, axis=0), axis=1))
    # what would lead too far is shortened: a little less than asked for
    assert 0.8 * 10 < np.median(angle_deg) < 1.02 * 10
    assert np.abs(turns.target).max() <= 0.7


def test_longer_reaches_turn_further() -> None:
    turns = turning(ONE_HAND, TIMING, Stream.named(1, "turn"))
    angle = np.log(np.linalg.norm(np.diff(turns.target, axis=0), axis=1))
    inner = np.exp(angle) < 0.35  # not shortened
    assert np.corrcoef(angle[inner], TIMING.length_score[inner])[0, 1] > 0.8


@pytest.mark.parametrize("turn_deg", [0.0, 19.0])
def test_a_hand_that_turns_by_no_angle_keeps_its_orientation(turn_deg: float) -> None:
    source = ONE_HAND.model_copy(update={"turn_deg": turn_deg})
    orientation = synthesise(source, 1, 30, 600, 0).hands[0].follower.orientation
    assert (np.ptp(orientation, axis=0).max() > 0.1) == (turn_deg > 0)
