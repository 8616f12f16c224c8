import numpy as np
import pytest

from tis.common.metrics.orientation import angles_deg, error_vectors, orientation_at


def about(axis: int, degrees: float) -> list[float]:
    half = np.radians(degrees) / 2
    quaternion = [0.0, 0.0, 0.0, float(np.cos(half))]
    quaternion[axis] = float(np.sin(half))
    return quaternion


def test_the_angle_is_that_of_the_rotation_between() -> None:
    one = np.array([about(2, 10), about(0, 0), about(1, 179), about(0, 90)])
    other = np.array([about(2, 40), [0, 0, 0, -1], about(1, -179), about(1, 90)])
    # 358 degrees the long way are 2 the short one; two quarter turns about x and y are 120 apart
    assert angles_deg(error_vectors(one, other)) == pytest.approx([30, 0, 2, 120], abs=1e-6)
    assert error_vectors(np.empty((0, 4)), np.empty((0, 4))).shape == (0, 3)


def test_the_vector_is_in_the_frame_of_the_estimate_and_unknown_without_both() -> None:
    # turned by 90 degrees about z, the body's x points along y: 10 degrees about the world's y are about its x
    half = np.radians(5)
    estimate = np.array([about(2, 90), about(2, 90), [np.nan] * 4])
    x, y, z, w = 0.0, np.sin(half), 0.0, np.cos(half)
    ax, ay, az, aw = about(2, 90)
    turned = [w * ax + x * aw + y * az - z * ay, w * ay - x * az + y * aw + z * ax,
              w * az + x * ay - y * ax + z * aw, w * aw - x * ax - y * ay - z * az]  # fmt: skip
    truth = np.array([turned, [np.nan] * 4, about(2, 90)])
    found = error_vectors(estimate, truth)
    assert found[0] == pytest.approx([np.radians(10), 0, 0], abs=1e-12)
    assert np.isnan(found[1:]).all()


def test_orientation_turns_at_constant_speed_between_samples_and_is_unknown_outside() -> None:
    sample_ns = np.array([0, 100, 300])
    samples = np.array([about(2, 0), about(2, 20), about(2, 60)])
    t_ns = np.array([-1, 0, 50, 200, 300, 301])
    found = orientation_at(t_ns, sample_ns, samples)
    assert np.isnan(found[[0, -1]]).all()
    expected = np.array([about(2, degrees) for degrees in (0, 10, 40, 60)])
    assert angles_deg(error_vectors(found[1:-1], expected)) == pytest.approx([0] * 4, abs=1e-5)
    assert np.isnan(orientation_at(t_ns, sample_ns[:1], samples[:1])).all()
