"""Truth, estimate and hold at a tick, by hand."""

from math import sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.deploy.watch.making import LEFT, sighting
from tis.common.messages import FeedbackPose, PredictedPose, Quaternion, Vector3, encode
from tis.common.units import NS_PER_MS
from tis.deploy.watch.arms import ArmMotion, ArmRow, DisplayRow, Displays, Trail
from tis.deploy.watch.book import LiveBook

MS = 1_000_000


def test_truth_is_interpolated_and_known_one_sample_later() -> None:
    motion = ArmMotion()
    motion.sent(0, (0.0, 0.0, 0.0))
    motion.arrived(0, (0.0, 0.0, 0.0))
    motion.estimated(5 * MS, 0, (0.004, 0.0, 0.0))
    assert motion.rows() == []
    motion.sent(10 * MS, (0.010, 0.020, 0.0))
    (row,) = motion.rows()
    assert row.truth_m == pytest.approx((0.005, 0.010, 0.0))
    assert row.error_mm == pytest.approx((1 + 100) ** 0.5)  # 1 mm along x, 10 mm along y
    assert row.hold_error_mm == pytest.approx((25 + 100) ** 0.5)
    assert motion.rows() == []


def test_a_tick_on_a_sample_takes_that_sample() -> None:
    motion = ArmMotion()
    motion.sent(0, (0.001, 0.002, 0.003))
    motion.arrived(0, (0.001, 0.002, 0.003))
    motion.estimated(0, 0, (0.001, 0.002, 0.004))
    (row,) = motion.rows()
    assert row[:4] == (0, (0.001, 0.002, 0.003), (0.001, 0.002, 0.004), (0.001, 0.002, 0.003))
    assert (row.error_mm, row.hold_error_mm) == pytest.approx((1.0, 0.0))


def test_hold_is_the_freshest_sample_that_had_arrived_whatever_came_last() -> None:
    motion = ArmMotion()
    for i in range(4):
        motion.sent(10 * i * MS, (0.001 * i, 0.0, 0.0))
    motion.arrived(20 * MS, (0.002, 0.0, 0.0))
    motion.arrived(10 * MS, (0.001, 0.0, 0.0))
    motion.estimated(30 * MS, 20 * MS, (0.003, 0.0, 0.0))
    motion.arrived(30 * MS, (0.003, 0.0, 0.0))  # after the estimate was seen
    (row,) = motion.rows()
    assert row.hold_m == (0.002, 0.0, 0.0)
    assert (row.error_mm, row.hold_error_mm) == pytest.approx((0.0, 1.0))


def test_a_sample_that_the_tick_did_not_have_yet_is_not_held() -> None:
    """At 0 ms delay the observer may see a sample before the estimate of the tick that came before it."""
    motion = ArmMotion()
    for i in range(3):
        motion.sent(10 * i * MS, (0.001 * i, 0.0, 0.0))
        motion.arrived(10 * i * MS, (0.001 * i, 0.0, 0.0))
    motion.estimated(11 * MS, 0, (0.0, 0.0, 0.0))
    motion.estimated(12 * MS, 10 * MS, (0.001, 0.0, 0.0))
    assert [row.hold_m for row in motion.rows()] == [(0.0, 0.0, 0.0), (0.001, 0.0, 0.0)]


def test_there_is_nothing_to_compare_before_the_first_samples() -> None:
    motion = ArmMotion()
    motion.estimated(5 * MS, 0, (0.0, 0.0, 0.0))  # nothing to hold yet
    motion.arrived(0, (0.0, 0.0, 0.0))
    motion.estimated(6 * MS, 0, (0.0, 0.0, 0.0))  # its truth was sent before anybody looked
    motion.sent(10 * MS, (0.0, 0.0, 0.0))
    motion.sent(20 * MS, (0.0, 0.0, 0.0))
    assert motion.rows() == []


def test_copies_of_a_sample_change_nothing() -> None:
    motion = ArmMotion()
    motion.sent(0, (0.0, 0.0, 0.0))
    motion.sent(10 * MS, (0.010, 0.0, 0.0))
    motion.sent(0, (9.0, 9.0, 9.0))
    motion.arrived(0, (0.0, 0.0, 0.0))
    motion.estimated(5 * MS, 0, (0.005, 0.0, 0.0))
    assert motion.rows()[0].error_mm == pytest.approx(0.0)


def test_angles_to_the_true_orientation_are_degrees_by_hand() -> None:
    def about_z(degrees: float) -> np.ndarray:
        half = np.radians(degrees) / 2
        return np.array([0.0, 0.0, np.sin(half), np.cos(half)])

    motion, here = ArmMotion(), (0.0, 0.0, 0.0)
    motion.sent(0, here, about_z(0))
    motion.arrived(0, here, about_z(0))
    motion.estimated(5 * MS, 0, here, about_z(12))
    motion.sent(10 * MS, here, -about_z(40))  # the same orientation as with the other sign
    (row,) = motion.rows()
    assert row.turn_error_deg == pytest.approx(8.0)
    assert row.hold_turn_error_deg == pytest.approx(20.0)
    motion.estimated(10 * MS, 0, here, None)
    (row,) = motion.rows()
    assert row.turn_error_deg is None
    assert row.hold_turn_error_deg == pytest.approx(40.0)


_LEVEL = Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)


def _display(t_ms: int, shown_m: float, predicted_m: float, late_ms: int = 200) -> bytes:
    message = PredictedPose(
        sample_ns=t_ms * NS_PER_MS, position_m=Vector3(x=predicted_m, y=0.0, z=0.0), orientation=_LEVEL,
        gripper_rad=0.0, hand="left", tick=0, shown_tick=0, shown_m=Vector3(x=shown_m, y=0.0, z=0.0),
        command_ns=(t_ms - late_ms) * NS_PER_MS, round_trip_ns=180 * NS_PER_MS,
    )  # fmt: skip
    return encode(message)


def _arm(t_ms: int, x_m: float, command_ms: int | None) -> bytes:
    message = FeedbackPose(
        sample_ns=t_ms * NS_PER_MS, position_m=Vector3(x=x_m, y=0.0, z=0.0), orientation=_LEVEL, gripper_rad=0.0,
        tick=0, command_sample_ns=None if command_ms is None else command_ms * NS_PER_MS,
    )  # fmt: skip
    return encode(message)


def _filled() -> Displays:
    displays = Displays("tis")
    for t_ms, shown_m, predicted_m in ((1000, 0.010, 0.014), (1100, 0.012, 0.018), (1200, 0.014, 0.022)):
        displays.take("west", "tis/PSM2/predicted_cp", _display(t_ms, shown_m, predicted_m), 0)
    # the command of 1000 ms acts at 1130 ms; that of 1100 was lost, so 1200 acts in its place; nothing acts after it
    for t_ms, x_m, command_ms in ((1090, 0.009, 990), (1130, 0.015, 1000), (1340, 0.019, 1200)):
        displays.take("east", "tis/PSM2/measured_cp", _arm(t_ms, x_m, command_ms), 0)
    return displays


def test_errors_are_against_the_arm_that_has_the_command() -> None:
    found = _filled().errors(0)
    assert found is not None
    # 10 and 14 mm against 15; 12 and 18, and 14 and 22, against 19
    assert found.feedback_mm == pytest.approx(sqrt((5**2 + 7**2 + 5**2) / 3))
    assert found.predicted_mm == pytest.approx(sqrt((1**2 + 1**2 + 3**2) / 3))


def test_only_displays_of_the_window_count() -> None:
    found = _filled().errors(1_150 * NS_PER_MS)
    assert found is not None
    assert (found.feedback_mm, found.predicted_mm) == pytest.approx((5.0, 3.0))
    assert _filled().errors(2_000 * NS_PER_MS) is None
    assert Displays("tis").errors(0) is None


def test_rows_are_kept_by_arm_and_only_newer_readable_ones_are_added() -> None:
    displays = _filled()
    key, other = "tis/PSM2/predicted_cp", "tis/PSM2/measured_cp"
    for payload in (b"", b"{}", b'{"sample_ns": 1}', _display(1200, 9.0, 9.0), _display(99_000, 9.0, 9.0)):
        displays.take("west", key, payload, 1_300 * NS_PER_MS)
    for payload in (_arm(1300, 9.0, 1200), _arm(1400, 9.0, None), b"\xff"):
        displays.take("east", other, payload, 1_300 * NS_PER_MS)
    newest = displays.rows["PSM2"].all()[-1]
    assert newest == DisplayRow(1_200 * NS_PER_MS, (0.014, 0.0, 0.0), (0.022, 0.0, 0.0), 200 * NS_PER_MS)
    assert displays.arms["PSM2"].all()[-1] == ArmRow(1_340 * NS_PER_MS, (0.019, 0.0, 0.0), 1_200 * NS_PER_MS)
    assert displays.rows["PSM1"].n == 0


def test_the_book_listens_to_the_display_in_the_west_and_to_the_arm_in_the_east() -> None:
    book = LiveBook("tis")
    assert sorted(book.displays.keys("west")) == ["tis/PSM1/predicted_cp", "tis/PSM2/predicted_cp"]
    assert sorted(book.displays.keys("east")) == ["tis/PSM1/measured_cp", "tis/PSM2/measured_cp"]
    for network, channel, payload in (
        ("west", LEFT.predicted, _display(1000, 0.010, 0.014)),
        ("west", LEFT.measured, _arm(1010, 9.0, 1000)),  # as it arrives: that is no news
        ("east", LEFT.measured, _arm(1130, 0.015, 1000)),
    ):
        book.take(sighting(network, channel, 0, 0, 0, payload))  # type: ignore[arg-type]
    assert book.figures().display == pytest.approx((5.0, 1.0))


@settings(max_examples=50)
@given(most=st.integers(1, 6), batches=st.lists(st.integers(0, 9), max_size=8))
def test_a_reader_sees_every_row_once_but_those_that_went_before_it_came(most: int, batches: list[int]) -> None:
    trail: Trail[int] = Trail(most)
    everything: list[int] = []
    n_read = 0
    for n in batches:
        for _ in range(n):
            trail.append(len(everything))
            everything.append(len(everything))
        assert trail.since(n_read) == everything[max(n_read, len(everything) - most) :]
        assert trail.all() == everything[-most:]
        n_read = trail.n


def test_a_reader_that_is_ahead_gets_nothing() -> None:
    trail: Trail[str] = Trail(3)
    trail.append("a")
    assert trail.since(1) == trail.since(2) == []
