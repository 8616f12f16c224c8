import numpy as np
import pytest

from patient_side.learning.calibration import AGES, covariance_scale, nearest_age
from tests.patient_side.learning.tracks import some_examples


def test_the_nearest_age_is_that_on_a_logarithmic_scale() -> None:
    assert nearest_age(np.array([[0.06, 1.6, 1.8, 150.0, 400.0]])).tolist() == [[0, 0, 1, 6, 6]]


def test_a_deviation_that_is_half_the_true_one_needs_a_factor_of_four() -> None:
    examples = some_examples(n_tracks=10, n_passes=2)
    errors = np.random.default_rng(0).normal(size=examples.left.shape)
    found = covariance_scale(errors, np.full(examples.ages.shape, np.log(0.5)), examples)
    assert found.shape == AGES.shape
    # With few windows a factor keeps part of its weight only.
    assert found[0] == pytest.approx(4.0, rel=0.1)
    assert np.all(found > 1.0)
    assert np.all(found < 4.5)
