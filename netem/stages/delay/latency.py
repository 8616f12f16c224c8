"""The sum of delay and jitter that a packet gets, and what is known about it before anything is drawn."""

from collections.abc import Iterable
from dataclasses import dataclass
from math import sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from netem.draws.blocks import Floats
from netem.stages.delay.crossing import crossing
from netem.stages.delay.jitter import Jitter
from netem.stages.delay.law import Delay

_WIDTH_NS: Final = 1e-3


@dataclass(frozen=True)
class LatencyModel:
    """What a pipeline asks for before ordering: delay plus jitter, from one uniform for each of the two."""

    delay: Delay
    jitter: Jitter | None = None

    def sample(self, u_delay: Floats, u_jitter: Floats) -> NDArray[np.int64]:
        """Return the delays in ns, (N,), never negative, for uniforms (N,) in (0, 1).

        Oracle: scipy.stats, and a loop that really redraws (tests/netem/stages/delay/test_latency).
        """
        return self.with_jitter(self.delay.quantile_ns(u_delay), u_jitter)

    def with_jitter(self, delay_ns: Floats, u_jitter: Floats) -> NDArray[np.int64]:
        """Return given delays (N,) plus jitter, in whole ns, (N,), never negative."""
        if self.jitter is not None:
            # the sum may miss 0 by a rounding error, where the deviation is at its bound
            delay_ns = np.maximum(delay_ns + self.jitter.quantile_ns(u_jitter, delay_ns), 0.0)
        return np.rint(delay_ns).astype(np.int64)

    @property
    def mean_ns(self) -> float:
        """Mean of the requested distribution, in ns, after truncation and redraws."""
        return self.delay.moments_ns()[0] + self._shift_ns()

    @property
    def std_ns(self) -> float:
        """Standard deviation of the requested distribution, in ns, by the law of total variance."""
        mean_ns, variance = self.delay.moments_ns()
        jitter = self.jitter
        if jitter is None:
            return sqrt(variance)
        shift_ns = self._shift_ns()

        def spread(delay_ns: Floats) -> Floats:
            deviation_ns, own = jitter.moments_ns(delay_ns)
            # the delay's own spread, which may be unbounded, is left out: it is known
            return own + (deviation_ns - shift_ns) ** 2 + 2.0 * (delay_ns - mean_ns) * deviation_ns

        return sqrt(max(variance + self.delay.expect(spread, jitter.bends_ns), 0.0))

    def quantiles_ns(self, ps: Iterable[float]) -> list[float]:
        """Return the delays in ns that shares ``ps``, each in (0, 1), of the packets do not exceed.

        Without jitter the quantiles of the distribution itself; with it the roots of the sum's distribution
        function, which is integrated, to 0.001 ns. Oracle: samples, and scipy.stats where it has the sum.
        """
        points = np.array(list(ps), dtype=np.float64)
        quantiles_ns = self.delay.quantile_ns(points)
        jitter = self.jitter
        if jitter is None or jitter.reach_ns == 0.0:
            return [float(quantile_ns) for quantile_ns in quantiles_ns]
        return [self._quantile_ns(jitter, float(p), float(q)) for p, q in zip(points, quantiles_ns, strict=True)]

    def _quantile_ns(self, jitter: Jitter, p: float, about_ns: float) -> float:
        """Return a quantile of the sum: within the jitter's reach of the delay's own quantile."""
        reach_ns, bends_ns = jitter.reach_ns, jitter.bends_ns

        def excess(x_ns: float) -> float:
            places_ns = np.concatenate([bends_ns, x_ns - bends_ns, x_ns + bends_ns])
            return self.delay.expect(lambda delay_ns: jitter.cdf(x_ns - delay_ns, delay_ns), places_ns) - p

        return crossing(excess, max(about_ns - reach_ns, 0.0), about_ns + reach_ns, _WIDTH_NS)

    def _shift_ns(self) -> float:
        """Return the jitter's mean: above 0 where deviations are redrawn."""
        jitter = self.jitter
        if jitter is None:
            return 0.0
        return self.delay.expect(lambda delay_ns: jitter.moments_ns(delay_ns)[0], jitter.bends_ns)
