import numpy as np
import pytest

from tests.patient_side.learned.test_transformer import path
from tis.patient_side.learned import informer
from tis.patient_side.learned.informer import distilled, encode, sparse_attention
from tis.patient_side.learned.layers import dense, softmax
from tis.patient_side.learned.transformer import WIDTH
from tis.patient_side.model_fields import Floats

RNG = np.random.default_rng(0)


def test_queries_that_stand_out_attend_and_the_others_read_the_mean() -> None:
    scores, values = RNG.normal(size=(2, 4, 17, 17)), RNG.normal(size=(2, 4, 17, 8))
    found = sparse_attention(np, scores, values)
    for b in range(2):
        for head in range(4):
            of = scores[b, head]
            active = np.argsort(of.max(axis=1) - of.mean(axis=1))[-9:]  # ceil(3 ln 17) = 9
            for i in range(17):
                expected = softmax(np, of[i]) @ values[b, head] if i in active else values[b, head].mean(axis=0)
                np.testing.assert_allclose(found[b, head, i], expected, atol=1e-12)


def test_few_tokens_all_attend() -> None:
    scores, values = RNG.normal(size=(1, 1, 3, 3)), RNG.normal(size=(1, 1, 3, 2))
    np.testing.assert_allclose(sparse_attention(np, scores, values), softmax(np, scores) @ values, atol=1e-12)


@pytest.mark.parametrize(("n_tokens", "n_left"), [(17, 9), (16, 8)])
def test_distilling_keeps_the_larger_one_of_two_convolved_tokens(n_tokens: int, n_left: int) -> None:
    x = RNG.normal(size=(2, n_tokens, 5))
    weights = {"d.weight": RNG.normal(size=(15, 5)), "d.bias": RNG.normal(size=5)}
    found = distilled(np, weights, "d", x)
    assert found.shape == (2, n_left, 5)

    def convolved(i: int) -> Floats:
        beside = [x[0, max(i - 1, 0)], x[0, i], x[0, min(i + 1, n_tokens - 1)]]
        y = dense(weights, "d", np.concatenate(beside))
        return np.asarray(np.where(y > 0, y, np.expm1(y)))

    for k in range(n_tokens // 2):
        np.testing.assert_allclose(found[0, k], np.maximum(convolved(2 * k), convolved(2 * k + 1)), atol=1e-12)
    if n_tokens % 2:
        np.testing.assert_allclose(found[0, -1], convolved(n_tokens - 1), atol=1e-12)


def test_the_summary_depends_on_every_step() -> None:
    weights = {name: 0.3 * RNG.normal(size=shape) for name, shape in informer.shapes().items()}
    steps, context = path(n=1)
    before = encode(np, weights, steps, context)
    assert before.shape == (1, WIDTH)
    for i in (0, 31, 63):
        changed = steps.copy()
        changed[0, i] += 1.0
        assert not np.allclose(encode(np, weights, changed, context), before)
