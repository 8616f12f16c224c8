import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import asdict

from tests.nodes import a_pose
from tis.common.messages import MAX_SIZE, FeedbackPose, Pose, Vector3
from tis.common.units import sample_instant_ns
from tis.surgeon_side.commanded_arm import CommandedArm
from tis.surgeon_side.predictive_display import PredictiveDisplay

MS = 1_000_000


def _hand_m(t_s: float) -> float:
    """A movement without a period within ten seconds."""
    return 0.02 * math.sin(2.1 * t_s) + 0.01 * math.sin(5.3 * t_s + 1.0) + 0.004 * math.sin(9.7 * t_s)


def _command(tick: int) -> Pose:
    sample_ns = sample_instant_ns(tick, 30)
    return a_pose(_hand_m(sample_ns / 1e9), sample_ns=sample_ns)


def _feedback(tick: int, t_ns: int, x_m: float, command_ns: int | None) -> FeedbackPose:
    return FeedbackPose(**asdict(a_pose(x_m, sample_ns=t_ns)), tick=tick, command_sample_ns=command_ns)


def _display() -> PredictiveDisplay:
    return PredictiveDisplay("left", CommandedArm(30))


def test_feedback_is_moved_on_by_what_was_commanded_since() -> None:
    display = _display()
    for tick in range(10):
        display.command(tick, a_pose(0.001 * tick, -0.002 * tick, 5.0, sample_instant_ns(tick, 30)))
    command_ns = sample_instant_ns(4, 30)
    shown = _feedback(6, sample_instant_ns(6, 30), 0.3, command_ns)
    display.feedback(shown, sample_instant_ns(8, 30))
    command = a_pose(0.009, -0.018, 5.0, sample_instant_ns(9, 30))
    found = display.show(9, command)
    assert found is not None
    # five samples are not in the feedback yet: 5 mm along x, -10 mm along y
    assert (found.position_m.x, found.position_m.y, found.position_m.z) == pytest.approx((0.305, -0.01, 0.0))
    assert found.shown_m == shown.position_m
    assert (found.tick, found.shown_tick, found.sample_ns) == (9, 6, sample_instant_ns(9, 30))
    assert found.round_trip_ns == sample_instant_ns(8, 30) - command_ns
    assert (found.orientation, found.gripper_rad) == (command.orientation, command.gripper_rad)


@pytest.mark.parametrize("offset_m", [0.0, 0.1])
def test_an_arm_at_its_newest_command_is_predicted_where_the_newest_command_is(offset_m: float) -> None:
    # each feedback answers the command of eight ticks before it arrives; the arm stands beside by the offset
    display = _display()
    for tick in range(300):
        display.command(tick, _command(tick))
        if tick >= 8:
            answered = _command(tick - 8)
            arm_m = answered.position_m.x + offset_m
            feedback = _feedback(tick - 5, answered.sample_ns + 102 * MS, arm_m, answered.sample_ns)
            display.feedback(feedback, sample_instant_ns(tick, 30))
            found = display.show(tick, _command(tick))
            assert found is not None
            assert found.position_m.x == pytest.approx(_command(tick).position_m.x + offset_m, abs=1e-12)


def test_an_estimator_that_makes_up_for_the_delay_is_found_by_its_fit() -> None:
    # the arm is where the hand is: the feedback is as old as its way back, not as its command
    display = _display()
    for tick in range(200):
        now_ns = sample_instant_ns(tick, 30)
        display.command(tick, _command(tick))
        if tick >= 10:
            t_ns = sample_instant_ns(tick - 5, 30)
            back = _feedback(tick - 5, t_ns, _hand_m(t_ns / 1e9), sample_instant_ns(tick - 9, 30))
            display.feedback(back, now_ns)
            found = display.show(tick, _command(tick))
            assert found is not None
            if tick >= 40:
                assert found.position_m.x == pytest.approx(_hand_m(now_ns / 1e9), abs=1e-9)


def test_an_arm_that_lags_behind_its_command_is_found_by_its_fit() -> None:
    display = _display()
    for tick in range(200):
        display.command(tick, _command(tick))
        if tick >= 15:
            command_ns = sample_instant_ns(tick - 5, 30)
            lagging_m = display.arm.at(command_ns - 100 * MS)
            assert lagging_m is not None
            display.feedback(
                _feedback(tick - 4, command_ns + 35 * MS, lagging_m[0], command_ns), command_ns + 150 * MS
            )
            found = display.show(tick, _command(tick))
            assert found is not None
            if tick >= 40:
                assert found.position_m.x == pytest.approx(_command(tick).position_m.x, abs=1e-9)


def test_nothing_is_shown_before_a_feedback_that_answers_a_command() -> None:
    display = _display()
    display.command(0, _command(0))
    assert display.show(0, _command(0)) is None
    display.feedback(_feedback(0, 2 * MS, 0.0, None), 50 * MS)
    assert display.show(0, _command(0)) is None
    display.feedback(_feedback(0, 2 * MS, 0.0, -(10**17)), 50 * MS)
    assert display.show(0, _command(0)) is None, "it answers a command that was never given"


def test_an_older_feedback_that_comes_late_is_ignored() -> None:
    display = _display()
    for tick in range(6):
        display.command(tick, _command(tick))
    display.feedback(_feedback(5, 160 * MS, 0.5, 100 * MS), 200 * MS)
    display.feedback(_feedback(4, 130 * MS, 0.1, 66 * MS), 210 * MS)
    found = display.show(5, _command(5))
    assert found is not None
    assert (found.shown_tick, found.shown_m) == (5, Vector3(x=0.5, y=0.0, z=0.0))


_ANY = st.floats(-MAX_SIZE, MAX_SIZE)


@given(st.lists(st.tuples(_ANY, st.integers(-(1 << 62), 1 << 62), st.integers(-(1 << 62), 1 << 62)), max_size=20))
def test_whatever_arrives_is_shown_or_not_and_raises_nothing(found: list[tuple[float, int, int]]) -> None:
    display = _display()
    for tick, (x_m, t_ns, command_ns) in enumerate(found):
        command = a_pose(x_m, sample_ns=sample_instant_ns(tick, 30))
        display.command(tick, command)
        display.feedback(_feedback(tick, t_ns, -x_m, command_ns), sample_instant_ns(tick, 30))
        shown = display.show(tick, command)
        assert shown is None or abs(shown.position_m.x) <= MAX_SIZE
