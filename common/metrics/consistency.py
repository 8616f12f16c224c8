"""Consistency of an estimator's stated errors: normalised squares and coverage, axis by axis.

Bar-Shalom, Li and Kirubarajan, *Estimation with Applications to Tracking and Navigation* (2001), section 5.4: for a
consistent filter the squared error over the stated variance is chi squared with one degree of freedom, so its mean is
1 and the mean of n independent ones lies between quantiles of chi squared (n) over n. Computed from the truth it is
the NEES, from measurements that are new to the filter the NIS. Neighbouring ticks are correlated, so n is the
effective number of ticks by batch means.
"""

from typing import Any, Final

import numpy as np
import scipy
from numpy.typing import NDArray

from tis.common.metrics.fidelity import batch_inflation
from tis.common.metrics.loss import loss_interval

Array = NDArray[np.float64]

LEVEL: Final = 0.95
"""Probability of the bounds, and of the intervals whose coverage is counted."""

CHI2_3_95: Final = 7.814727903251179
"""95 % quantile of chi squared with 3 degrees of freedom: the squared radius of the ellipsoid of a 3D error."""

CHI2_1_95: Final = 3.841458820694124
"""95 % quantile of chi squared with 1 degree of freedom."""

_HALF_WIDTH: Final = 1.959963984540054
"""Half width of the 95 % interval of a normal error, in standard deviations."""


def normalised_squares(error_m: Array, std_m: Array) -> Array:
    """Return ``(e / sigma)**2``, (T, 3); NaN where either is not finite, 0 where both are 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        squares = (error_m / std_m) ** 2
    exact = (std_m == 0.0) & (error_m == 0.0)
    return np.where(exact, 0.0, np.where(np.isfinite(error_m) & np.isfinite(std_m), squares, np.nan))


def mean_square_bounds(n_effective: float) -> tuple[float, float]:
    """Return the 95 % bounds of the mean of ``n_effective`` > 0 squares of a consistent filter.

    Quantiles of chi squared (n) over n (oracle: `scipy.stats.chi2`, test_consistency).
    """
    low, high = (
        2.0 * float(scipy.special.gammaincinv(n_effective / 2.0, share)) / n_effective
        for share in ((1 - LEVEL) / 2, (1 + LEVEL) / 2)
    )
    return low, high


def region_pct(squares: Array) -> float | None:
    """Return the share of errors within their 95 % region, from normalised squares (T, d) with d of 1 or 3.

    The region is that of independent axes: an ellipsoid, or an interval. None without rows. Oracle: errors of known
    deviation, test_consistency.
    """
    rows = squares[~np.isnan(squares).any(axis=1)]
    limit = CHI2_3_95 if squares.shape[1] > 1 else CHI2_1_95
    return 100.0 * float(np.mean(rows.sum(axis=1) <= limit)) if len(rows) else None


def consistency(squares: Array) -> dict[str, Any]:
    """Return the summary's entry for normalised squares (T, 3), lists are x, y, z; ``n`` counts the rows in use.

    An axis is ``consistent`` when its ``mean`` lies within ``bounds_95``; above, the filter is overconfident, below,
    too cautious. ``coverage_pct`` is the share of errors within 1.96 stated deviations, ideally 95; its interval
    allows for correlation. Without rows all are None. Oracle: errors of known deviation, test_consistency.
    """
    rows = squares[~np.isnan(squares).any(axis=1)]
    n = len(rows)
    nothing: list[Any] = [None, None, None]
    names = ("mean", "bounds_95", "consistent", "coverage_pct", "coverage_pct_interval_95")
    if n == 0:
        return {"n": 0, **dict.fromkeys(names, nothing)}
    axes = [_axis(rows[:, axis]) for axis in range(rows.shape[1])]
    return {"n": n, **{name: [axis[name] for axis in axes] for name in names}}


def _axis(squares: Array) -> dict[str, Any]:
    # A stated deviation of 0 with an error makes an infinite square: no mean, but the coverage is defined.
    finite = np.isfinite(squares).all()
    mean = float(squares.mean()) if finite else None
    centred = squares - squares.mean() if finite else squares
    inflation = batch_inflation(centred, float(squares.var())) if finite else 1.0
    bounds = mean_square_bounds(len(squares) / inflation)
    outside = squares > _HALF_WIDTH**2
    low, high = loss_interval(outside)
    return {
        "mean": mean,
        "bounds_95": list(bounds),
        "consistent": mean is not None and bounds[0] <= mean <= bounds[1],
        "coverage_pct": 100.0 * float(1.0 - outside.mean()),
        "coverage_pct_interval_95": [100.0 * (1.0 - high), 100.0 * (1.0 - low)],
    }
