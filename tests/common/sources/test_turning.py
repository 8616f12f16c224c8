import numpy as np
import pytest

from tis.common.scenario.source import SyntheticSource
from tis.common.sources.reaching import timing_of
from tis.common.sources.synthetic import synthesise, turning
from tis.common.streams import Stream

PLAIN = SyntheticSource(kind="synthetic", turn_deg=10.0)
TIMING = timing_of(PLAIN, 1.0, Stream.named(1, "timing"), 3000.0)


def test_each_reach_turns_the_hand_within_its_time_by_the_angle_asked_for() -> None:
    turns = turning(PLAIN, TIMING, Stream.named(1, "turn"))
    assert len(turns.onset_s) == len(TIMING.onset_s)
    assert (turns.onset_s >= TIMING.onset_s).all()
    assert (turns.onset_s + turns.duration_s <= TIMING.onset_s + TIMING.duration_s + 1e-9).all()
    angle_deg = np.degrees(np.linalg.norm(np.diff(turns.target, axis=0), axis=1))
    # what would lead too far is shortened: a little less than asked for
    assert 0.8 * 10 < np.median(angle_deg) < 1.02 * 10
    assert np.abs(turns.target).max() <= 0.7


def test_longer_reaches_turn_further() -> None:
    turns = turning(PLAIN, TIMING, Stream.named(1, "turn"))
    angle = np.log(np.linalg.norm(np.diff(turns.target, axis=0), axis=1))
    inner = np.exp(angle) < 0.35  # not shortened
    assert np.corrcoef(angle[inner], TIMING.length_score[inner])[0, 1] > 0.8


@pytest.mark.parametrize("turn_deg", [0.0, 19.0])
def test_a_hand_that_turns_by_no_angle_keeps_its_orientation(turn_deg: float) -> None:
    source = PLAIN.model_copy(update={"turn_deg": turn_deg})
    orientation = synthesise(source, 1, 30, 600, 0).hands[0].follower.orientation
    assert (np.ptp(orientation, axis=0).max() > 0.1) == (turn_deg > 0)
