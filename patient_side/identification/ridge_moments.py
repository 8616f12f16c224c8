"""Ridge regressions from second moments: sums over rows, by groups that are held out together."""

from math import sqrt
from typing import NamedTuple

import numpy as np

from patient_side.statespace import Array


class Moments(NamedTuple):
    """Second moments of regressors (G, K, K), with the errors (G, K, R), of the errors (G,), by group, and counts."""

    past: Array
    cross: Array
    square: Array
    n: Array


def solutions(moments: Moments, precision: Array) -> tuple[Array, list[Array]]:
    """Return the ridge solutions (K, R) of all rows, and for each group of the rows outside it.

    ``precision`` (K,) is the inverse variance of a coefficient's prior, times the rows that are alike, for regressors
    and errors in units of their deviations.
    """

    def solved(past: Array, cross: Array, square: float, n: float) -> Array:
        size = np.sqrt(np.diag(past))
        if n <= 0 or square <= 0 or not np.all(np.isfinite(size)):
            return np.zeros_like(cross)
        # Regressors in units of the errors; one that vanishes gets the coefficient 0.
        unit = np.divide(sqrt(square), size, out=np.zeros_like(size), where=size > 0)
        normal = (n / square) * unit[:, None] * past * unit + np.diag(precision)
        return np.asarray(unit[:, None] * np.linalg.solve(normal, (n / square) * unit[:, None] * cross))

    total = Moments(*(each.sum(axis=0) for each in moments))
    by_group = [
        solved(total.past - past, total.cross - cross, float(total.square - square), float(total.n - n))
        for past, cross, square, n in zip(*moments, strict=True)
    ]
    return solved(total.past, total.cross, float(total.square), float(total.n)), by_group


def empty_moments(n_groups: int, size: int, n_errors: int) -> Moments:
    """Return moments of no rows, of ``size`` regressors with ``n_errors`` errors."""
    return Moments(
        np.zeros((n_groups, size, size)), np.zeros((n_groups, size, n_errors)), np.zeros(n_groups), np.zeros(n_groups)
    )
