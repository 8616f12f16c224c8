import numpy as np

from tests.patient_side.learning.tracks import some_examples
from tis.patient_side.learning.calibration import AGES, covariance_scale, mean_share, nearest_age, shared


def test_the_nearest_age_is_that_on_a_logarithmic_scale() -> None:
    assert nearest_age(np.array([[0.06, 1.6, 1.8, 150.0, 400.0]])).tolist() == [[0, 0, 1, 6, 6]]


def test_a_deviation_that_is_half_the_true_one_needs_a_factor_of_four() -> None:
    examples = some_examples(n_tracks=10, n_passes=2)
    errors = np.random.default_rng(0).normal(size=examples.left.shape)
    found = covariance_scale(errors, np.full(examples.ages.shape, np.log(0.5)), examples)
    assert found.shape == (2, len(AGES))
    # With few windows a factor keeps part of its weight only.
    np.testing.assert_allclose(found[:, 0], 4.0, rtol=0.15)
    assert np.all(found > 1.0)
    assert np.all(found < 4.5)


def test_the_share_of_the_truth_is_1_of_twice_the_truth_a_half_and_of_noise_nothing() -> None:
    examples = some_examples(n_tracks=10, n_passes=2)
    truth = examples.left.astype(float)
    np.testing.assert_allclose(mean_share(truth, examples), 1.0)
    np.testing.assert_allclose(mean_share(2.0 * truth, examples), 0.5)
    assert np.all(mean_share(-truth, examples) == 0.0)
    noise = np.random.default_rng(0).normal(size=truth.shape) * np.abs(truth)
    assert np.all(mean_share(noise, examples) < 0.35)


def test_a_share_between_two_ages_is_interpolated() -> None:
    mean = np.ones((1, 2, 3))
    found = shared(mean, np.array([1.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0]), np.array([[np.sqrt(3.0), 6.0]]))
    np.testing.assert_allclose(found[0, :, 0], [0.75, 0.0], atol=1e-12)
