"""A causal convolutional network over the recent path (Bai, Kolter and Koltun 2018, temporal convolutional networks).

Five convolutions over three steps, each with a residual path and half the steps of the one before: the newest step of
each sees 3, 7, 15, 31 and 63 steps back. The newest steps of the last four and the context of older samples are the
summary.
"""

from typing import Any, Final

from tis.patient_side.learned.inputs import N_CONTEXT, N_STEP
from tis.patient_side.learned.layers import Array, Arrays, Shapes, dense, dense_shapes, gelu

CHANNELS: Final = 32
N_CONVOLUTIONS: Final = 5
OLDER: Final = 16
WIDTH: Final = 48


def shapes() -> Shapes:
    """Return the shapes of the encoder's weights."""
    found: Shapes = {}
    n_in = N_STEP
    for k in range(N_CONVOLUTIONS):
        found |= dense_shapes(f"convolution{k}", 3 * n_in, CHANNELS) | dense_shapes(f"residual{k}", n_in, CHANNELS)
        n_in = CHANNELS
    found |= dense_shapes("context", N_CONTEXT, OLDER)
    return found | dense_shapes("summary", (N_CONVOLUTIONS - 1) * CHANNELS + OLDER, WIDTH)


def encode(xp: Any, weights: Arrays, steps: Array, context: Array) -> Array:
    """Return the summary (B, 48) of steps (B, 64, 8) and context (B, 52)."""
    x, newest = steps, []
    for k in range(N_CONVOLUTIONS):
        x = convolved(xp, weights, k, x)
        newest.append(x[:, 0])
    older = xp.tanh(dense(weights, "context", context))
    return gelu(xp, dense(weights, "summary", xp.concatenate([*newest[1:], older], axis=-1)))


def convolved(xp: Any, weights: Arrays, k: int, x: Array) -> Array:
    """Return every second step (B, T / 2, 32) of x (B, T, n): from itself and the two before it, zeros at the end."""
    b, t, n = x.shape
    padded = xp.concatenate([x, xp.zeros((b, 1, n), dtype=x.dtype)], axis=1)
    three = xp.concatenate([padded[:, 0:t:2], padded[:, 1:t:2], padded[:, 2 : t + 1 : 2]], axis=-1)
    return gelu(xp, dense(weights, f"convolution{k}", three)) + dense(weights, f"residual{k}", x[:, ::2])
