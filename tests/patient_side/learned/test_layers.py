import math

import numpy as np
import pytest

from tis.patient_side.learned.layers import (
    dense,
    feed_forward,
    feed_forward_shapes,
    gelu,
    heads_of,
    joined,
    normalised,
    softmax,
)
from tis.patient_side.model_fields import Floats


def drawn(*shape: int) -> Floats:
    return np.random.default_rng(0).normal(size=shape)


def test_a_dense_layer_is_a_matrix_and_a_bias() -> None:
    weights = {"a.weight": np.array([[1.0, 2.0], [3.0, 4.0]]), "a.bias": np.array([0.5, -0.5])}
    assert np.array_equal(dense(weights, "a", np.array([[1.0, 1.0]])), [[4.5, 5.5]])


def test_normalised_rows_have_mean_0_and_variance_1() -> None:
    found = normalised(np, 5.0 + 3.0 * drawn(4, 50))
    np.testing.assert_allclose(found.mean(axis=1), 0.0, atol=1e-12)
    np.testing.assert_allclose(found.var(axis=1), 1.0, atol=1e-5)


@pytest.mark.parametrize("x", [-3.0, -0.5, 0.0, 0.7, 4.0])
def test_gelu_is_x_times_the_normal_distribution(x: float) -> None:
    exact = x * 0.5 * (1.0 + math.erf(x / math.sqrt(2.0)))
    assert gelu(np, np.array(x)) == pytest.approx(exact, abs=1e-3)


def test_softmax_adds_up_to_1_and_does_not_overflow() -> None:
    found = softmax(np, np.array([[1000.0, 1000.0 + math.log(3.0)]]))
    np.testing.assert_allclose(found, [[0.25, 0.75]])


def test_heads_are_columns_and_come_together_again() -> None:
    x = drawn(2, 5, 8)
    heads = heads_of(np, x, 4)
    assert np.array_equal(heads[1, 2], x[1, :, 4:6])
    assert np.array_equal(joined(np, heads), x)


def test_a_residual_block_without_weights_changes_nothing() -> None:
    weights = {name: np.zeros(shape) for name, shape in feed_forward_shapes("a", 6, 12).items()}
    x = drawn(3, 6)
    assert np.array_equal(feed_forward(np, weights, "a", x), x)
