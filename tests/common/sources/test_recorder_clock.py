"""The clock behind a recording's rows: found where there is one, and its rows made even again."""

import numpy as np
import pytest

from tis.common.scenario.source import SyntheticSource
from tis.common.sources.recorder_clock import RecorderClock, even_hand, find_clock
from tis.common.sources.synthetic import synthesise
from tis.common.sources.trajectory import Array, HandRecording

N = 900


def hands(recorder_hz: float | None, seed: int = 1) -> tuple[HandRecording, ...]:
    source = SyntheticSource(kind="synthetic", hands=("left", "right"), recorder_hz=recorder_hz)
    return synthesise(source, seed, 30, N, 0).hands


def places(recorded: tuple[HandRecording, ...]) -> list[Array]:
    return [hand.follower.position_m for hand in recorded]


@pytest.mark.parametrize("recorder_hz", [40.0, 51.33, 77.7])
def test_a_recorders_rate_is_found(recorder_hz: float) -> None:
    found = find_clock(places(hands(recorder_hz)))
    assert found is not None
    assert 30 * found.samples_a_row == pytest.approx(recorder_hz, abs=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_even_rows_have_no_clock_nor_have_few_rows_or_a_hand_at_rest(seed: int) -> None:
    even = places(hands(None, seed))
    assert find_clock(even) is None
    assert find_clock([each[:200] for each in places(hands(51.33, seed))]) is None
    assert find_clock([np.zeros((N, 3))]) is None


def test_rows_made_even_are_those_of_an_even_clock() -> None:
    recorded, even = hands(51.33), hands(None)
    clock = find_clock(places(recorded))
    assert clock is not None
    (hand, _), (other, _) = (tuple(even_hand(each, clock) for each in recorded), even)

    def off_m(of: HandRecording) -> float:
        """The deviation from even rows, but for the recorder's mean lateness of half a sample."""
        moved = np.gradient(other.follower.position_m, axis=0)
        late = of.follower.position_m - other.follower.position_m + 0.5 / clock.samples_a_row * moved
        return float(np.sqrt(np.mean(np.square(late[5:-5]))))

    assert off_m(hand) < 0.1 * off_m(recorded[0])
    assert np.linalg.norm(hand.follower.orientation, axis=1) == pytest.approx(np.ones(N))


def test_the_mean_instant_is_that_of_an_even_clock_and_steps_are_whole_samples() -> None:
    instants = RecorderClock(1.7, 0.3).instants(100)
    assert np.mean(instants - np.arange(100)) == pytest.approx(0.0, abs=1e-12)
    assert set(np.round(1.7 * np.diff(instants), 9)) == {1.0, 2.0}
