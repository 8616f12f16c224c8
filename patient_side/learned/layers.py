"""Layers of networks, on numpy arrays or JAX's: ``xp`` is the library. Weights are arrays by name.

Oracles in test_layers: their definitions, element by element.
"""

from collections.abc import Mapping
from typing import Any, Final

Array = Any
"""An array of the library ``xp``."""
Arrays = Mapping[str, Array]
Shapes = dict[str, tuple[int, ...]]

_EPSILON: Final = 1e-5


def dense_shapes(name: str, n_in: int, n_out: int) -> Shapes:
    """Return the shapes of a dense layer's weights."""
    return {f"{name}.weight": (n_in, n_out), f"{name}.bias": (n_out,)}


def dense(weights: Arrays, name: str, x: Array) -> Array:
    """Return ``x W + b`` for x (..., n_in)."""
    return x @ weights[f"{name}.weight"] + weights[f"{name}.bias"]


def normalised(xp: Any, x: Array) -> Array:
    """Return x (..., d) with mean 0 and variance 1 over its last axis (Ba, Kiros and Hinton 2016, layer norm)."""
    x = x - x.mean(axis=-1, keepdims=True)
    return x / xp.sqrt((x * x).mean(axis=-1, keepdims=True) + _EPSILON)


def gelu(xp: Any, x: Array) -> Array:
    """Return the Gaussian error linear unit in its tanh form (Hendrycks and Gimpel 2016, equation 2)."""
    return 0.5 * x * (1.0 + xp.tanh(0.7978845608 * (x + 0.044715 * x * x * x)))


def softmax(xp: Any, x: Array) -> Array:
    """Return exponentials over their sum, along the last axis."""
    e = xp.exp(x - x.max(axis=-1, keepdims=True))
    return e / e.sum(axis=-1, keepdims=True)


def heads_of(xp: Any, x: Array, n_heads: int) -> Array:
    """Return x (B, T, d) as (B, heads, T, d / heads)."""
    b, t, d = x.shape
    return xp.swapaxes(x.reshape(b, t, n_heads, d // n_heads), 1, 2)


def joined(xp: Any, x: Array) -> Array:
    """Return x (B, heads, T, d / heads) as (B, T, d)."""
    b, n, t, d = x.shape
    return xp.swapaxes(x, 1, 2).reshape(b, t, n * d)


def feed_forward_shapes(name: str, d: int, hidden: int) -> Shapes:
    """Return the shapes of a residual block of two dense layers."""
    return dense_shapes(f"{name}.up", d, hidden) | dense_shapes(f"{name}.down", hidden, d)


def feed_forward(xp: Any, weights: Arrays, name: str, x: Array) -> Array:
    """Return x plus two dense layers of its normalised self (pre-norm: Xiong et al. 2020)."""
    up = gelu(xp, dense(weights, f"{name}.up", normalised(xp, x)))
    return x + dense(weights, f"{name}.down", up)
