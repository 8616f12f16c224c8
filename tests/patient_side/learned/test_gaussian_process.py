import numpy as np
import pytest

from tests.patient_side.learned.models import learned_model
from tests.patient_side.learned.test_inputs import window
from tis.patient_side.learned.gaussian_process import AGES, GROUPS, N_FEATURES, at_ages, features_of, kernel, outputs
from tis.patient_side.learned.inputs import activity_of, scaled


def test_the_kernel_is_that_of_each_pair() -> None:
    x, z = np.random.default_rng(0).normal(size=(2, 4, 3))
    found = kernel(x, z)
    assert found[1, 2] == pytest.approx(np.exp(-np.sum((x[1] - z[2]) ** 2) / 2))
    assert kernel(x, x).diagonal() == pytest.approx(1.0)


def test_features_are_in_units_of_the_activity_and_bounded_in_growth() -> None:
    found = window(2)
    activity = activity_of(found, 1e-3)
    features = features_of(scaled(found, activity, 1e-3, 0.5))
    assert features.shape == (4, N_FEATURES)
    assert len(GROUPS) == N_FEATURES
    unit = 1e-3 * activity[1]
    np.testing.assert_allclose(
        features[1, 3:6], np.arcsinh((found.way_m[1, 1] - found.way_m[1, 2]) / unit), rtol=1e-4
    )
    # The third way is that of 15 steps back.
    np.testing.assert_allclose(features[1, 30:33], np.arcsinh(found.way_m[1, 15] / unit / np.sqrt(15)), rtol=1e-4)
    assert features[1, -3] == pytest.approx(np.log(activity[1]), rel=1e-5)
    assert features[1, -1] == 1.0


def test_outputs_are_sums_over_the_points() -> None:
    weights = learned_model("gpr").weights
    x = np.random.default_rng(1).normal(size=(3, N_FEATURES))
    mean, deviation = outputs(weights, x)
    z = weights["root"] @ kernel(x * weights["scale"], weights["points"].astype(float))[1]
    for a in range(len(AGES)):
        np.testing.assert_allclose(mean[1, a], z @ weights["mean"][a], rtol=1e-5)
        unknown = max(1.0 - sum(z**2 * (1.0 - weights["left"][a])), 0.0)
        expected = weights["signal"][a] * unknown + weights["noise"][a]
        assert deviation[1, a] ** 2 == pytest.approx(expected, rel=1e-5)


def test_between_two_ages_it_is_interpolated_on_a_logarithmic_scale() -> None:
    mean = np.arange(9.0)[None, :, None] * np.ones(3)
    deviation = 1.0 + np.arange(9.0)[None]
    found, spread = at_ages(mean, deviation, np.array([[0.2, 1.0, np.sqrt(6.0 * 10.0), 150.0, 400.0]]))
    np.testing.assert_allclose(found[0, :, 0], [0.0, 0.0, 3.5, 8.0, 8.0])
    np.testing.assert_allclose(spread[0], [1.0, 1.0, 4.5, 9.0, 9.0])
