"""A small causal transformer over the recent path (Vaswani et al. 2017, "Attention is all you need").

A token is a patch of eight steps, the newest first; the last token is the context of older samples. Each token
attends to itself and to older ones only, and the newest one summarises the path.
"""

from typing import Any, Final

import numpy as np

from tis.patient_side.learned.inputs import N_CONTEXT, N_FINE, N_STEP
from tis.patient_side.learned.layers import (
    Array,
    Arrays,
    Shapes,
    dense,
    dense_shapes,
    feed_forward,
    feed_forward_shapes,
    heads_of,
    joined,
    normalised,
    softmax,
)

WIDTH: Final = 32
N_HEADS: Final = 4
N_BLOCKS: Final = 2
PATCH: Final = 8
N_TOKENS: Final = N_FINE // PATCH + 1

_NEVER: Final = -1e9
_SEEN: Final = np.triu(np.ones((N_TOKENS, N_TOKENS), dtype=np.bool_))
"""Token i sees token j where j is not newer."""


def shapes() -> Shapes:
    """Return the shapes of the encoder's weights."""
    found = token_shapes(PATCH, WIDTH)
    for k in range(N_BLOCKS):
        found |= block_shapes(f"block{k}", WIDTH)
    return found


def encode(xp: Any, weights: Arrays, steps: Array, context: Array) -> Array:
    """Return the summary (B, 32) of steps (B, 64, 8) and context (B, 52)."""
    x = tokens(xp, weights, steps, context, PATCH)
    for k in range(N_BLOCKS):
        scores, v = attention(xp, weights, f"block{k}", x)
        shares = softmax(xp, xp.where(_SEEN, scores, _NEVER))
        x = x + dense(weights, f"block{k}.out", joined(xp, shares @ v))
        x = feed_forward(xp, weights, f"block{k}.mlp", x)
    return normalised(xp, x[:, 0])


def token_shapes(patch: int, width: int) -> Shapes:
    """Return the shapes of the weights that make tokens."""
    n_tokens = N_FINE // patch + 1
    found = dense_shapes("patch", patch * N_STEP, width) | dense_shapes("context", N_CONTEXT, width)
    return found | {"place.weight": (n_tokens, width)}


def tokens(xp: Any, weights: Arrays, steps: Array, context: Array, patch: int) -> Array:
    """Return the tokens (B, T, d): patches of steps and the context, each with a learned vector of its place."""
    patches = dense(weights, "patch", steps.reshape(len(steps), N_FINE // patch, patch * N_STEP))
    older = dense(weights, "context", context)[:, None]
    return xp.concatenate([patches, older], axis=1) + weights["place.weight"]


def block_shapes(name: str, width: int) -> Shapes:
    """Return the shapes of a block: attention, and a residual block of two dense layers."""
    found: Shapes = {}
    for part in ("query", "key", "value", "out"):
        found |= dense_shapes(f"{name}.{part}", width, width)
    return found | feed_forward_shapes(f"{name}.mlp", width, 2 * width)


def attention(xp: Any, weights: Arrays, name: str, x: Array) -> tuple[Array, Array]:
    """Return the scaled products of queries and keys (B, heads, T, T), and the values (B, heads, T, d / heads)."""
    whole = normalised(xp, x)
    q, k, v = (heads_of(xp, dense(weights, f"{name}.{part}", whole), N_HEADS) for part in ("query", "key", "value"))
    return q @ xp.swapaxes(k, 2, 3) / (WIDTH // N_HEADS) ** 0.5, v
