import numpy as np

from tis.patient_side.learned import transformer
from tis.patient_side.learned.layers import dense, feed_forward, normalised
from tis.patient_side.learned.transformer import N_BLOCKS, N_HEADS, N_TOKENS, PATCH, WIDTH, encode, tokens
from tis.patient_side.model_fields import Floats


def weights(seed: int = 0) -> dict[str, Floats]:
    rng = np.random.default_rng(seed)
    return {name: 0.3 * rng.normal(size=shape) for name, shape in transformer.shapes().items()}


def path(seed: int = 1, n: int = 3) -> tuple[Floats, Floats]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, 64, 8)), rng.normal(size=(n, 52))


def by_loops(w: dict[str, Floats], steps: Floats, context: Floats) -> Floats:
    """The encoder for one path, head by head and token by token."""
    x = tokens(np, w, steps[None], context[None], PATCH)[0]
    m = WIDTH // N_HEADS
    for k in range(N_BLOCKS):
        whole = normalised(np, x)
        q, key, v = (dense(w, f"block{k}.{part}", whole) for part in ("query", "key", "value"))
        read = np.zeros_like(x)
        for head in range(N_HEADS):
            own = slice(head * m, (head + 1) * m)
            for i in range(N_TOKENS):
                seen = range(i, N_TOKENS)  # itself and what is older
                shares = np.exp([q[i, own] @ key[j, own] / np.sqrt(m) for j in seen])
                read[i, own] = sum(s * v[j, own] for s, j in zip(shares / shares.sum(), seen, strict=True))
        x = x + dense(w, f"block{k}.out", read)
        x = feed_forward(np, w, f"block{k}.mlp", x)
    return np.asarray(normalised(np, x[0]))


def test_the_summary_is_that_of_attention_worked_out_token_by_token() -> None:
    w, (steps, context) = weights(), path()
    found = encode(np, w, steps, context)
    assert found.shape == (3, WIDTH)
    for i in range(3):
        np.testing.assert_allclose(found[i], by_loops(w, steps[i], context[i]), atol=1e-10)


def test_a_token_is_a_patch_of_eight_steps_and_the_last_one_the_context() -> None:
    w, (steps, context) = weights(), path(n=1)
    found = tokens(np, w, steps, context, PATCH)[0] - w["place.weight"]
    np.testing.assert_allclose(found[2], dense(w, "patch", steps[0, 16:24].ravel()), atol=1e-12)
    np.testing.assert_allclose(found[-1], dense(w, "context", context[0]), atol=1e-12)
