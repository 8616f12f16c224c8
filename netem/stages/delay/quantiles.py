"""An empirical distribution of delays: linear interpolation between known quantiles."""

from dataclasses import dataclass

import numpy as np

from tis.netem.draws.blocks import Floats
from tis.netem.stages.delay.law import ContinuousDelay


@dataclass(frozen=True, eq=False)
class QuantileDelay(ContinuousDelay):
    """A quantile table: ``shares`` (N,) ascend strictly from 0 to 1, ``delays_ns`` (N,) do not descend."""

    shares: Floats
    delays_ns: Floats

    def quantile_ns(self, u: Floats) -> Floats:
        """Return the delays, shape of ``u``."""
        return np.interp(u, self.shares, self.delays_ns)

    def cdf(self, delay_ns: Floats) -> Floats:
        """Return the share of delays at most ``delay_ns``, same shape; it jumps where quantiles are equal."""
        after = np.searchsorted(self.delays_ns, delay_ns, side="right")
        low, high = np.maximum(after - 1, 0), np.minimum(after, len(self.shares) - 1)
        width_ns = self.delays_ns[high] - self.delays_ns[low]
        part = np.where(width_ns > 0, (delay_ns - self.delays_ns[low]) / np.where(width_ns > 0, width_ns, 1.0), 0.0)
        return np.asarray(np.where(after == 0, 0.0, self.shares[low] + part * (self.shares[high] - self.shares[low])))

    def knots(self) -> Floats:
        """Return the probabilities of the table."""
        return self.shares

    def moments_ns(self) -> tuple[float, float]:
        """Return mean (ns) and variance (ns^2): each piece is uniform."""
        widths = np.diff(self.shares)
        middles_ns = (self.delays_ns[:-1] + self.delays_ns[1:]) / 2.0
        mean_ns = float((widths * middles_ns).sum())
        within = np.diff(self.delays_ns) ** 2 / 12.0
        return mean_ns, float((widths * ((middles_ns - mean_ns) ** 2 + within)).sum())
