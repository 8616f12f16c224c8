import numpy as np
import pytest

from tis.common.scenario.live_source import LivePlaces, LiveSource
from tis.common.scenario.source import SyntheticSource
from tis.common.sources.synthetic import synthesise, synthetic_training, unmade_movement


def test_nothing_is_known_of_a_live_movement_but_its_hands() -> None:
    movement = unmade_movement(LiveSource(kind="live", hands=("right", "left")), 30)
    assert [(hand.hand, hand.arm) for hand in movement.hands] == [("right", "PSM1"), ("left", "PSM2")]
    assert len(movement) == 0


def test_with_the_default_places_it_is_the_synthetic_hand() -> None:
    made = synthetic_training(LiveSource(kind="live"), 7, 30, 200).hands[0]
    plain = synthesise(SyntheticSource(kind="synthetic"), 7, 30, 200, 0).hands[0]
    assert np.allclose(made.command.position_m, plain.command.position_m, atol=1e-12)
    assert np.allclose(made.follower.position_m, plain.follower.position_m, atol=1e-12)


@pytest.mark.parametrize("hand", ["left", "right"])
def test_the_arm_is_the_masters_movement_at_the_sources_scale_and_places(hand: str) -> None:
    """Least squares of the arm on the master finds scale and offset, up to 15 um that no gain explains."""
    source = LiveSource(
        kind="live",
        hands=("left", "right"),
        scale=0.2,
        master_at_mm=LivePlaces(left=(1, 2, 3), right=(4, 5, 6)),
        arm_at_mm=LivePlaces(left=(-10, 0, 10), right=(0, 30, 0)),
    )
    made = {each.hand: each for each in synthetic_training(source, 3, 100, 2000).hands}[hand]  # type: ignore[index]
    master_m, arm_m = made.command.position_m, made.follower.position_m
    places = {"left": ((1, 2, 3), (-10, 0, 10)), "right": ((4, 5, 6), (0, 30, 0))}[hand]
    for axis in range(3):
        slope, offset_m = np.polyfit(master_m[:, axis], arm_m[:, axis], 1)
        assert slope == pytest.approx(0.2, abs=1e-3)
        assert offset_m == pytest.approx((places[1][axis] - 0.2 * places[0][axis]) / 1000, abs=1e-4)
