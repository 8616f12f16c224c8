"""Growth of an estimator's error from one setting to another, of the same people, with a bootstrap interval."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from deploy.compare.results.pooled import resampled, sums_of

Hands = Sequence[Mapping[str, Any]]
_TAILS = (2.5, 97.5)


class Growth(NamedTuple):
    """A ratio of RMSE in 3D with its 95 % interval over people, None of a single person."""

    ratio: float
    low: float | None
    high: float | None
    n_people: int


def error_growth(here: Mapping[str, Hands], there: Mapping[str, Hands], estimator: str) -> Growth | None:
    """Return the RMSE ``here`` over that ``there``, of the people that both have; None without any or without error.

    Both hold each person's hands (see `deploy.compare.cells.score.hand_sums`). A resample takes the same people on
    both sides, as the movements are the same. Oracle: errors written by hand, and a loop over resamples,
    test_error_growth.
    """
    people = [who for who in here if who in there]
    if not people:
        return None
    # (side, person, [sum of squares, ticks])
    parts = np.array([[_squares_and_ticks(side[who], estimator) for who in people] for side in (here, there)])
    ratio = float(_root_ratio(parts.sum(axis=1)[:, None])[0])
    if not np.isfinite(ratio):
        return None
    again = _root_ratio(parts[:, resampled(len(people))].sum(axis=2))
    if len(people) < 2 or not np.isfinite(again).all():
        return Growth(ratio, None, None, len(people))
    low, high = np.percentile(again, _TAILS)
    return Growth(ratio, float(low), float(high), len(people))


def _squares_and_ticks(hands: Hands, estimator: str) -> tuple[float, float]:
    sums = sums_of(hands, estimator)
    return float(sums.sse.sum()), float(sums.n)


def _root_ratio(parts: "np.ndarray[tuple[int, ...], np.dtype[np.float64]]") -> Any:
    """Return the ratio of root mean squares of sums (side, resample, [squares, ticks])."""
    with np.errstate(divide="ignore", invalid="ignore"):
        means = parts[..., 0] / parts[..., 1]
        return np.sqrt(means[0] / means[1])
