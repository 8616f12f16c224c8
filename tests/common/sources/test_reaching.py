import numpy as np
import pytest

from tis.common.scenario.source import SyntheticSource
from tis.common.sources.minimum_jerk import Movements
from tis.common.sources.reaching import reaching, timing_of
from tis.common.streams import Stream

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
