"""The interface of every distribution of one-way delay."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Final

import numpy as np

from tis.netem.draws.blocks import Floats

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
_FRACTIONS: Final = (_NODES + 1.0) / 2.0
_SHARES: Final = _WEIGHTS / 2.0
# dense towards both ends, where quantile functions have their singularities
_HALVINGS: Final = 0.5 ** np.arange(50, 0, -1)
_MAX_U: Final = 1.0 - 2.0**-53


class Delay(ABC):
    """A distribution of non-negative delays, in ns; it draws a delay from one uniform by its quantile function."""

    @abstractmethod
    def quantile_ns(self, u: Floats) -> Floats:
        """Return the quantile for each uniform in (0, 1), shape of ``u``."""

    @abstractmethod
    def cdf(self, delay_ns: Floats) -> Floats:
        """Return the share of delays at most ``delay_ns``, same shape."""

    @abstractmethod
    def moments_ns(self) -> tuple[float, float]:
        """Return mean (ns) and variance (ns^2) of the drawn delays, after all redraws."""

    def knots(self) -> Floats:
        """Return the probabilities at which the quantile function bends."""
        return np.empty(0)

    def expect(self, f: Callable[[Floats], Floats], bends_ns: Floats) -> float:
        """Return the mean of a bounded ``f`` of the delay, by Gauss-Legendre quadrature over the probability.

        Intervals end where the quantile function or ``f`` bends, at delays ``bends_ns``, and halve towards 0 and 1. A
        tail of probability 2^-50 is not resolved, so ``f`` must be bounded. Oracle: scipy.integrate,
        tests/netem/stages/delay/test_law.
        """
        inner = np.concatenate([_HALVINGS, 1.0 - _HALVINGS, self.knots(), self.cdf(np.maximum(bends_ns, 0.0))])
        edges = np.unique(np.concatenate([[0.0, 1.0], np.clip(inner, 0.0, 1.0)]))
        widths = np.diff(edges)
        u = np.minimum(edges[:-1, None] + widths[:, None] * _FRACTIONS, _MAX_U)
        values = f(self.quantile_ns(u.ravel())).reshape(u.shape)
        return float(((values * _SHARES).sum(axis=1) * widths).sum())
