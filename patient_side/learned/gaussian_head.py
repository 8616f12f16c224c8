"""The end that all networks share: from a path's summary and an age to a normal distribution of what is left.

What is left is the arm's position less the linear forecast, in units of that forecast's own deviation and of the
hand's activity (Nix and Weigend 1994, "Estimating the mean and variance of the target probability distribution").
"""

from typing import Any, Final

from tis.patient_side.learned.inputs import N_AGE, N_BASE
from tis.patient_side.learned.layers import Array, Arrays, Shapes, dense, dense_shapes, gelu

HIDDEN: Final = 96
AXES: Final = 3
_LOWEST: Final = -4.0
_HIGHEST: Final = 3.0
"""Bounds of the deviation's logarithm."""


def shapes(n_summary: int) -> Shapes:
    """Return the shapes of the head's weights."""
    first = dense_shapes("head.first", n_summary + N_AGE + N_BASE, HIDDEN)
    return first | dense_shapes("head.second", HIDDEN, HIDDEN) | dense_shapes("head.last", HIDDEN, AXES + 1)


def distribution(xp: Any, weights: Arrays, summary: Array, ages: Array, moves: Array) -> tuple[Array, Array]:
    """Return means (B, K, 3) and logarithms of deviations (B, K).

    ``summary`` (B, d) is that of a path, ``ages`` (B, K, 7) are the inputs of K ages, ``moves`` (B, K, 3) the moves
    that the linear model forecasts over them.
    """
    b, n_ages = ages.shape[:2]
    of_path = xp.broadcast_to(summary[:, None], (b, n_ages, summary.shape[-1]))
    x = xp.concatenate([of_path, ages, xp.arcsinh(moves)], axis=-1)
    x = gelu(xp, dense(weights, "head.first", x))
    x = x + gelu(xp, dense(weights, "head.second", x))
    found = dense(weights, "head.last", x)
    return found[..., :AXES], xp.clip(found[..., AXES], _LOWEST, _HIGHEST)
