"""Random Fourier features: against the kernel that they stand for."""

import numpy as np
import pytest

from tis.patient_side.filters.correction import LENGTH, projections


def test_their_mean_product_is_the_gaussian_kernel() -> None:
    rng = np.random.default_rng(1)
    centre, deviation = rng.normal(size=4), rng.uniform(0.1, 9.0, 4)
    table = projections(centre, deviation, 100_000)
    inputs = centre + deviation * LENGTH * rng.normal(size=(6, 4)) / 2
    features = np.cos(inputs @ table[:, :-1].T + table[:, -1])
    apart = (inputs[:, None] - inputs[None]) / (deviation * LENGTH)
    kernel = np.exp(-np.sum(apart**2, axis=2) / 2)
    assert 2 * features @ features.T / len(table) == pytest.approx(kernel, abs=0.02)


def test_they_are_the_same_each_time() -> None:
    centre, deviation = np.zeros(3), np.ones(3)
    assert np.array_equal(projections(centre, deviation, 7), projections(centre, deviation, 7))
    assert projections(centre, deviation, 0).shape == (0, 4)
