import numpy as np
import pytest

from common.metrics.orientation import geodesic_deg, orientation_at


def about(axis: int, degrees: float) -> list[float]:
    half = np.radians(degrees) / 2
    quaternion = [0.0, 0.0, 0.0, float(np.cos(half))]
    quaternion[axis] = float(np.sin(half))
    return quaternion


def test_the_angle_is_that_of_the_rotation_between() -> None:
    one = np.array([about(2, 10), about(0, 0), about(1, 179), about(0, 90)])
    other = np.array([about(2, 40), [0, 0, 0, -1], about(1, -179), about(1, 90)])
    # 358 degrees the long way are 2 the short one; two quarter turns about x and y are 120 apart
    assert geodesic_deg(one, other) == pytest.approx([30, 0, 2, 120], abs=1e-6)
    assert geodesic_deg(np.empty((0, 4)), np.empty((0, 4))).tolist() == []


def test_orientation_turns_at_constant_speed_between_samples_and_is_unknown_outside() -> None:
    sample_ns = np.array([0, 100, 300])
    samples = np.array([about(2, 0), about(2, 20), about(2, 60)])
    t_ns = np.array([-1, 0, 50, 200, 300, 301])
    found = orientation_at(t_ns, sample_ns, samples)
    assert np.isnan(found[[0, -1]]).all()
    expected = np.array([about(2, degrees) for degrees in (0, 10, 40, 60)])
    assert geodesic_deg(found[1:-1], expected) == pytest.approx([0] * 4, abs=1e-5)
    assert np.isnan(orientation_at(t_ns, sample_ns[:1], samples[:1])).all()
