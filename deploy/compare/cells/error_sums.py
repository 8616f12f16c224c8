"""Sums of the errors of forecasts, a sum for each number of samples ahead: every definition of an error follows."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ErrorSums:
    """Sums over ``n`` forecasts of 1, 2, ... H samples ahead, in m and m^2.

    ``distance_m`` (H,) sums the 3D distances, ``absolute_m`` and ``squares_m2`` (H, 3) the errors of each axis.
    """

    n: int
    distance_m: Array
    absolute_m: Array
    squares_m2: Array

    @classmethod
    def of(cls, errors_m: Array) -> "ErrorSums":
        """Return the sums of errors (N, H, 3) in m. Oracle: values by hand in the tests."""
        squares = errors_m**2
        distances = np.sqrt(squares.sum(axis=2)).sum(axis=0)
        return cls(len(errors_m), distances, np.abs(errors_m).sum(axis=0), squares.sum(axis=0))

    @classmethod
    def total(cls, parts: Iterable["ErrorSums"]) -> "ErrorSums | None":
        """Return the sums over all parts, None without a part."""
        found = list(parts)
        if not found:
            return None
        return cls(
            sum(part.n for part in found),
            np.sum([part.distance_m for part in found], axis=0),
            np.sum([part.absolute_m for part in found], axis=0),
            np.sum([part.squares_m2 for part in found], axis=0),
        )

    @classmethod
    def from_json(cls, raw: dict[str, Any]) -> "ErrorSums":
        """Return the sums that `to_json` wrote."""
        return cls(raw["n"], *(np.array(raw[name]) for name in ("distance_m", "absolute_m", "squares_m2")))

    def to_json(self) -> dict[str, Any]:
        """Return the sums as JSON values."""
        return {
            "n": self.n,
            "distance_m": self.distance_m.tolist(),
            "absolute_m": self.absolute_m.tolist(),
            "squares_m2": self.squares_m2.tolist(),
        }
