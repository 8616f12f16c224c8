"""Truth, estimate and hold at a tick, by hand."""

import numpy as np
import pytest

from tis.deploy.watch.motion import ArmMotion

MS = 1_000_000


def test_truth_is_interpolated_and_known_one_sample_later() -> None:
    motion = ArmMotion()
    motion.sent(0, (0.0, 0.0, 0.0))
    motion.arrived(0, (0.0, 0.0, 0.0))
    motion.estimated(5 * MS, (0.004, 0.0, 0.0))
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
    motion.estimated(0, (0.001, 0.002, 0.004))
    (row,) = motion.rows()
    assert row[:4] == (0, (0.001, 0.002, 0.003), (0.001, 0.002, 0.004), (0.001, 0.002, 0.003))
    assert (row.error_mm, row.hold_error_mm) == pytest.approx((1.0, 0.0))


def test_hold_is_the_freshest_sample_that_had_arrived_whatever_came_last() -> None:
    motion = ArmMotion()
    for i in range(4):
        motion.sent(10 * i * MS, (0.001 * i, 0.0, 0.0))
    motion.arrived(20 * MS, (0.002, 0.0, 0.0))
    motion.arrived(10 * MS, (0.001, 0.0, 0.0))
    motion.estimated(30 * MS, (0.003, 0.0, 0.0))
    motion.arrived(30 * MS, (0.003, 0.0, 0.0))  # after the estimate was seen
    (row,) = motion.rows()
    assert row.hold_m == (0.002, 0.0, 0.0)
    assert (row.error_mm, row.hold_error_mm) == pytest.approx((0.0, 1.0))


def test_there_is_nothing_to_compare_before_the_first_samples() -> None:
    motion = ArmMotion()
    motion.estimated(5 * MS, (0.0, 0.0, 0.0))  # nothing to hold yet
    motion.arrived(0, (0.0, 0.0, 0.0))
    motion.estimated(6 * MS, (0.0, 0.0, 0.0))  # its truth was sent before anybody looked
    motion.sent(10 * MS, (0.0, 0.0, 0.0))
    motion.sent(20 * MS, (0.0, 0.0, 0.0))
    assert motion.rows() == []


def test_copies_of_a_sample_change_nothing() -> None:
    motion = ArmMotion()
    motion.sent(0, (0.0, 0.0, 0.0))
    motion.sent(10 * MS, (0.010, 0.0, 0.0))
    motion.sent(0, (9.0, 9.0, 9.0))
    motion.arrived(0, (0.0, 0.0, 0.0))
    motion.estimated(5 * MS, (0.005, 0.0, 0.0))
    assert motion.rows()[0].error_mm == pytest.approx(0.0)


def test_angles_to_the_true_orientation_are_degrees_by_hand() -> None:
    def about_z(degrees: float) -> np.ndarray:
        half = np.radians(degrees) / 2
        return np.array([0.0, 0.0, np.sin(half), np.cos(half)])

    motion, here = ArmMotion(), (0.0, 0.0, 0.0)
    motion.sent(0, here, about_z(0))
    motion.arrived(0, here, about_z(0))
    motion.estimated(5 * MS, here, about_z(12))
    motion.sent(10 * MS, here, -about_z(40))  # the same orientation as with the other sign
    (row,) = motion.rows()
    assert row.turn_error_deg == pytest.approx(8.0)
    assert row.hold_turn_error_deg == pytest.approx(20.0)
    motion.estimated(10 * MS, here, None)
    (row,) = motion.rows()
    assert row.turn_error_deg is None
    assert row.hold_turn_error_deg == pytest.approx(40.0)
