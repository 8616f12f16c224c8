import numpy as np

from tests.patient_side.learned.test_transformer import path
from tis.patient_side.learned import cnn
from tis.patient_side.learned.cnn import WIDTH, convolved, encode
from tis.patient_side.learned.layers import dense, gelu

RNG = np.random.default_rng(0)
WEIGHTS = {name: 0.3 * RNG.normal(size=shape) for name, shape in cnn.shapes().items()}


def test_a_convolution_reads_a_step_and_the_two_before_it() -> None:
    x = RNG.normal(size=(2, 64, 8))
    found = convolved(np, WEIGHTS, 0, x)
    assert found.shape == (2, 32, 32)
    older = np.concatenate([x, np.zeros((2, 1, 8))], axis=1)
    for k in (0, 7, 31):
        three = older[1, 2 * k : 2 * k + 3].ravel()
        expected = gelu(np, dense(WEIGHTS, "convolution0", three)) + dense(WEIGHTS, "residual0", x[1, 2 * k])
        np.testing.assert_allclose(found[1, k], expected, atol=1e-12)


def test_the_summary_reads_63_steps_and_no_more() -> None:
    steps, context = path(n=1)
    before = encode(np, WEIGHTS, steps, context)
    assert before.shape == (1, WIDTH)
    for i, matters in ((0, True), (40, True), (62, True), (63, False)):
        changed = steps.copy()
        changed[0, i] += 1.0
        assert np.allclose(encode(np, WEIGHTS, changed, context), before) != matters
