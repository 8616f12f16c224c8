"""The recorder's pattern: literal sample numbers, two sizes of increments, and none at a multiple of the rate."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.common.scenario.source import SyntheticSource
from tis.common.sources.synthetic import latest_sample_s, synthesise

ROWS_S = np.arange(3000) / 30


@pytest.mark.parametrize(("phase", "samples"), [(0.0, [0, 1, 3, 5, 6, 8, 10, 11]), (0.5, [0, 2, 3, 5, 7, 9, 10, 12])])
def test_rows_at_30_hz_show_these_samples_of_51_33_hz(phase: float, samples: list[int]) -> None:
    shown_s = latest_sample_s(ROWS_S[:8], 51.33, phase)
    assert shown_s == pytest.approx((np.array(samples) - phase) / 51.33, abs=1e-12)


@given(recorder_hz=st.floats(30.5, 59.5), phase=st.floats(0, 0.999))
def test_a_steady_movement_has_increments_of_two_sizes(recorder_hz: float, phase: float) -> None:
    per_row = np.diff(latest_sample_s(ROWS_S, recorder_hz, phase)) * recorder_hz
    assert set(np.round(per_row, 6).tolist()) == {1.0, 2.0}
    # as many halves as the mean rate requires, evenly spread; exact ties may round either way
    halves = np.abs(per_row - 1.0) < 0.5
    assert halves.mean() == pytest.approx(2.0 - recorder_hz / 30, abs=1e-3)
    assert np.ptp(np.convolve(halves, np.ones(100), "valid")) <= 2


@given(recorder_hz=st.floats(1, 1000), phase=st.floats(0, 0.999))
def test_the_latest_sample_is_neither_later_nor_older_than_one_before(recorder_hz: float, phase: float) -> None:
    age_s = ROWS_S - latest_sample_s(ROWS_S, recorder_hz, phase)
    assert age_s.min() > -1e-9
    assert age_s.max() < 1 / recorder_hz + 1e-9


@given(multiple=st.integers(1, 40), phase=st.floats(0.001, 0.999))
def test_a_multiple_of_the_rate_leaves_the_rows_evenly_spaced(multiple: int, phase: float) -> None:
    shown_s = latest_sample_s(ROWS_S, 30.0 * multiple, phase)
    assert np.abs(ROWS_S - shown_s - phase / (30.0 * multiple)).max() < 1e-9


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_masters_and_arms_of_both_hands_share_the_phase_and_seeds_differ(seed: int) -> None:
    still = {"tremor_mm": 0.0, "drift_mm": 0.0, "coupling": 0.0, "pause_s": 0.0, "movement_s": 60.0}
    slow = SyntheticSource.model_validate(
        {"kind": "synthetic", "hands": ["left", "right"], "recorder_hz": 10, **still}
    )

    def repeats(of_seed: int) -> list[list[bool]]:
        # 10 Hz seen at 30 Hz: the movement stands still in two rows of three
        hands = synthesise(slow, of_seed, 30, 60, 0).hands
        tracks = [track.position_m for hand in hands for track in (hand.command, hand.follower)]
        return [np.all(np.diff(position, axis=0) == 0, axis=1).tolist() for position in tracks]

    first, *others = repeats(seed)
    assert sum(first) == pytest.approx(40, abs=1)
    assert all(each == first for each in others)
    assert len({tuple(repeats(each)[0]) for each in range(8)}) == 3
