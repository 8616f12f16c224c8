"""Informer (Zhou et al. 2021, "Informer: beyond efficient transformer for long sequence time-series forecasting").

Two things differ from `transformer`: only the queries whose scores stand out attend, the others take the mean of all
values (ProbSparse attention, equation 3 of that paper), and between blocks a convolution and a maximum halve the
tokens (distilling, equation 5). All of the path lies in the past, so no token is hidden. Its inputs have zeros for
what is lost, as the authors of the testbed's paper propose; the transformer's are interpolated.
"""

from math import ceil, log
from typing import Any, Final

from tis.patient_side.learned.layers import (
    Array,
    Arrays,
    Shapes,
    dense,
    dense_shapes,
    feed_forward,
    joined,
    normalised,
    softmax,
)
from tis.patient_side.learned.transformer import WIDTH, attention, block_shapes, token_shapes, tokens

N_BLOCKS: Final = 2
PATCH: Final = 4

_FACTOR: Final = 3
"""The constant c: c ln T of T queries attend."""


def shapes() -> Shapes:
    """Return the shapes of the encoder's weights."""
    found = token_shapes(PATCH, WIDTH)
    for k in range(N_BLOCKS):
        found |= block_shapes(f"block{k}", WIDTH)
    for k in range(N_BLOCKS - 1):
        found |= dense_shapes(f"distil{k}", 3 * WIDTH, WIDTH)
    return found


def encode(xp: Any, weights: Arrays, steps: Array, context: Array) -> Array:
    """Return the summary (B, 32) of steps (B, 64, 8) and context (B, 52): the mean of the last tokens."""
    x = tokens(xp, weights, steps, context, PATCH)
    for k in range(N_BLOCKS):
        if k:
            x = distilled(xp, weights, f"distil{k - 1}", x)
        scores, v = attention(xp, weights, f"block{k}", x)
        x = x + dense(weights, f"block{k}.out", joined(xp, sparse_attention(xp, scores, v)))
        x = feed_forward(xp, weights, f"block{k}.mlp", x)
    return normalised(xp, x.mean(axis=1))


def sparse_attention(xp: Any, scores: Array, values: Array) -> Array:
    """Return what queries with scores (B, heads, T, T) read of values (B, heads, T, m).

    A query stands out by its largest score over its mean one; c ln T of them attend.
    """
    n_tokens = scores.shape[-1]
    n_active = min(n_tokens, ceil(_FACTOR * log(n_tokens)))
    standing_out = scores.max(axis=-1) - scores.mean(axis=-1)
    least = xp.sort(standing_out, axis=-1)[..., n_tokens - n_active, None]
    active = (standing_out >= least)[..., None]
    return xp.where(active, softmax(xp, scores) @ values, values.mean(axis=-2, keepdims=True))


def distilled(xp: Any, weights: Arrays, name: str, x: Array) -> Array:
    """Return half as many tokens: convolution over three, exponential linear unit, the larger one of each two."""
    padded = xp.concatenate([x[:, :1], x, x[:, -1:]], axis=1)
    mixed = dense(weights, name, xp.concatenate([padded[:, :-2], padded[:, 1:-1], padded[:, 2:]], axis=-1))
    bent = xp.where(mixed > 0.0, mixed, xp.exp(xp.minimum(mixed, 0.0)) - 1.0)
    n_pairs = bent.shape[1] // 2
    pairs = bent[:, : 2 * n_pairs].reshape(len(bent), n_pairs, 2, -1).max(axis=2)
    return xp.concatenate([pairs, bent[:, 2 * n_pairs :]], axis=1)
