"""Normal delay, redrawn while negative."""

from dataclasses import dataclass

from tis.netem.draws.blocks import Floats
from tis.netem.stages.delay.law import ContinuousDelay
from tis.netem.stages.delay.truncated_normal import cdf_above, moments_above, quantile_above


@dataclass(frozen=True)
class NormalDelay(ContinuousDelay):
    """Normal, truncated at 0; ``mean_ns`` and ``std_ns`` are those before truncation."""

    mean_ns: float
    std_ns: float

    def quantile_ns(self, u: Floats) -> Floats:
        """Return the delays, shape of ``u``."""
        return quantile_above(u, self.mean_ns, self.std_ns, 0.0)

    def cdf(self, delay_ns: Floats) -> Floats:
        """Return the share of delays at most ``delay_ns``, same shape."""
        return cdf_above(delay_ns, self.mean_ns, self.std_ns, 0.0)

    def moments_ns(self) -> tuple[float, float]:
        """Return mean (ns) and variance (ns^2) after truncation."""
        mean_ns, variance = moments_above(self.mean_ns, self.std_ns, 0.0)
        return float(mean_ns), float(variance)
