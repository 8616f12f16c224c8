"""The delays of a recorded trace, which repeats when it ends.

Delay and loss of one trace stay aligned: packet i (or a cell of run time) takes the same row of both. A lost row has
no delay; where the loss is not the trace's own, it takes the delay of the last received row before it, cyclically.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np

from tis.common.scenario.network import delay as network
from tis.common.scenario.network.loss import Loss
from tis.common.trace import Trace
from tis.netem.draws.blocks import Floats
from tis.netem.draws.grid import cells_of_rows
from tis.netem.stages.delay.laws import Delay


@dataclass(frozen=True, eq=False)
class EmpiricalDelay(Delay):
    """A discrete distribution: ``delays_ns`` (N,) ascend strictly, ``shares`` (N,) are its distribution function."""

    delays_ns: Floats
    shares: Floats

    @classmethod
    def of_trace(cls, part: network.TraceDelay, trace: Trace, loss: Loss | None) -> Self:
        """Return the distribution of a trace's delays over the packets that are not lost.

        Each row counts once, or by its duration. Where the loss is the same trace's, lost rows carry no packet.
        """
        weights = np.ones(len(trace.sent_ns)) if part.advance == "packet" else cells_of_rows(trace).astype(np.float64)
        if loss is not None and loss.kind == "trace" and (loss.path, loss.advance) == (part.path, part.advance):
            weights = np.where(trace.delay_ns >= 0, weights, 0.0)
        if not weights.any():  # no packet arrives
            weights = np.ones(len(trace.sent_ns))
        delays_ns, which = np.unique(row_delays_ns(trace), return_inverse=True)
        total = np.bincount(which, weights, len(delays_ns))
        drawn = total > 0
        shares = np.cumsum(total[drawn]) / weights.sum()
        return cls(delays_ns[drawn], np.minimum(shares, 1.0))

    def quantile_ns(self, u: Floats) -> Floats:
        """Return the delays, shape of ``u``."""
        return self.delays_ns[np.minimum(np.searchsorted(self.shares, u), len(self.delays_ns) - 1)]

    def cdf(self, delay_ns: Floats) -> Floats:
        """Return the share of delays at most ``delay_ns``, same shape."""
        return np.concatenate([[0.0], self.shares])[np.searchsorted(self.delays_ns, delay_ns, side="right")]

    def moments_ns(self) -> tuple[float, float]:
        """Return mean (ns) and variance (ns^2)."""
        weights = np.diff(self.shares, prepend=0.0)
        mean_ns = float((weights * self.delays_ns).sum())
        return mean_ns, float((weights * (self.delays_ns - mean_ns) ** 2).sum())

    def expect(self, f: Callable[[Floats], Floats], bends_ns: Floats) -> float:  # noqa: ARG002
        """Return the mean of ``f``, a sum."""
        return float((np.diff(self.shares, prepend=0.0) * f(self.delays_ns)).sum())


def row_delays_ns(trace: Trace) -> Floats:
    """Return the delay of each row in ns, (N,); a lost row takes that of the last received row before it.

    All are 0 if no row was received. Oracle: a loop over the rows, tests/netem/stages/delay/test_trace.
    """
    received = np.flatnonzero(trace.delay_ns >= 0)
    if not len(received):
        return np.zeros(len(trace.delay_ns))
    last = np.searchsorted(received, np.arange(len(trace.delay_ns)), side="right") - 1  # -1 wraps to the trace's end
    return trace.delay_ns[received[last]].astype(np.float64)
