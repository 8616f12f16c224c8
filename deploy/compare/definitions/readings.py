"""Readings of "the error of a forecast": four errors, at the horizon or over all steps up to it."""

from dataclasses import dataclass
from itertools import product
from math import sqrt
from typing import Final, Literal, get_args

import numpy as np

from tis.common.sources.jigsaws import RATE_HZ
from tis.deploy.compare.cells.error_sums import ErrorSums

Error = Literal["rmse_3d", "mean_distance", "rmse_axis", "mae_axis"]
Span = Literal["at", "up_to_30_hz", "up_to_10_hz"]

ERRORS: Final[tuple[Error, ...]] = get_args(Error)
SPANS: Final[tuple[Span, ...]] = get_args(Span)
HORIZONS_S: Final = (0.1, 0.5, 1.0, 2.0)
N_AHEAD: Final = round(HORIZONS_S[-1] * RATE_HZ)
ERROR_WORDS: Final[dict[Error, str]] = {
    "rmse_3d": "3D RMSE",
    "mean_distance": "3D mean distance",
    "rmse_axis": "RMSE of an axis",
    "mae_axis": "MAE of an axis",
}
SPAN_WORDS: Final[dict[Span, str]] = {
    "at": "at the horizon",
    "up_to_30_hz": "up to it, 30 Hz",
    "up_to_10_hz": "up to it, 10 Hz",
}
_EVERY: Final = RATE_HZ // 10


@dataclass(frozen=True)
class Reading:
    """One error over one span of steps."""

    error: Error
    span: Span


READINGS: Final = tuple(Reading(error, span) for span, error in product(SPANS, ERRORS))


def steps_of(span: Span, horizon_s: float) -> list[int]:
    """Return the numbers of samples ahead that a span covers, the horizon last."""
    last = round(horizon_s * RATE_HZ)
    if span == "at":
        return [last]
    every = _EVERY if span == "up_to_10_hz" else 1
    return list(range(every, last + 1, every))


def value_mm(sums: ErrorSums, reading: Reading, horizon_s: float) -> float:
    """Return the error in mm, pooled over all forecasts and steps.

    Parameters
    ----------
    sums : ErrorSums
        Sums over at least one forecast, of at least `horizon_s`.
    reading : Reading
        ``rmse_3d``: root of the mean squared distance. ``mean_distance``: mean of the distance. ``rmse_axis`` and
        ``mae_axis``: root of the mean square, and mean of the size, of x, y and z each, then the mean of the three.
    horizon_s : float
        One of `HORIZONS_S`.

    Returns
    -------
    float
        ``mae_axis <= rmse_axis <= rmse_3d`` and ``mean_distance <= rmse_3d``. Oracle: values by hand in the tests.
    """
    rows = np.array(steps_of(reading.span, horizon_s)) - 1
    count = sums.n * len(rows)
    squares_m2 = sums.squares_m2[rows].sum(axis=0) / count
    if reading.error == "rmse_3d":
        return 1000 * sqrt(squares_m2.sum())
    if reading.error == "rmse_axis":
        return 1000 * float(np.sqrt(squares_m2).mean())
    if reading.error == "mean_distance":
        return 1000 * float(sums.distance_m[rows].sum()) / count
    return 1000 * float(sums.absolute_m[rows].sum(axis=0).mean()) / count
