"""Integers with a heavy tail: floor(X) of a Pareto II (Lomax) X, P(X >= x) = (1 + x / scale) ** -shape.

Johnson, Kotz, Balakrishnan, "Continuous Univariate Distributions", vol. 1, section 20.3. Sums over the tail are
Hurwitz zeta functions: sum_{j >= n} (1 + j / scale) ** -shape = scale ** shape * zeta(shape, scale + n).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from tis.netem.draws.blocks import Floats

MAX_RUN: Final = 1 << 20
"""Bound on a draw, in packets: longer than a segment, so the bound has no effect."""


@dataclass(frozen=True)
class FlooredLomax:
    """K = floor(X); ``shape`` > 1, ``scale`` > 0."""

    shape: float
    scale: float

    def at_least(self, k: int) -> float:
        """Return P(K >= k), k >= 0."""
        return float((1.0 + k / self.scale) ** -self.shape)

    def tail_sum(self, k: int) -> float:
        """Return P(K >= k) + P(K >= k + 1) + ..., k >= 0: 1 + the mean for k = 0."""
        return float(self.scale**self.shape * scipy.special.zeta(self.shape, self.scale + k))

    @property
    def mean(self) -> float:
        """Return E[K] (oracle: a sum over the probabilities, tests/netem/stages/loss/test_lomax)."""
        return self.tail_sum(1)

    def quantiles(self, u: Floats) -> NDArray[np.int64]:
        """Return draws of K from uniforms in (0, 1), same shape, none above `MAX_RUN`."""
        # bounded before the conversion: a heavy tail exceeds the range of int64
        return np.minimum(self.scale * (u ** (-1.0 / self.shape) - 1.0), MAX_RUN).astype(np.int64)

    def residual(self, u: float) -> int:
        """Return the remaining length of a run of 1 + K packets at a random one of them, that one included.

        P(R > r) = tail_sum(r) / tail_sum(0), the equilibrium law of renewal theory (Cox 1962).
        """
        return _first(lambda r: self.tail_sum(r) <= u * self.tail_sum(0))

    def length_biased(self, u: float) -> int:
        """Return K of the run of 1 + K packets that contains a random packet: its law weighted by 1 + K.

        P(K >= k) = ((k + 1) P(K >= k) + P(K >= k + 1) + ...) / tail_sum(0).
        """
        whole = self.tail_sum(0)
        return _first(lambda r: (r + 1) * self.at_least(r) + self.tail_sum(r + 1) <= u * whole) - 1


def _first(holds: Callable[[int], bool]) -> int:
    """Return the first integer >= 1 from which ``holds`` is true, at most `MAX_RUN`, by bisection."""
    low, high = 0, MAX_RUN
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high
