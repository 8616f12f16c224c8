"""Alternating runs of received and lost packets with heavy-tailed lengths: an alternating renewal process."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from tis.common.scenario.network import loss as network
from tis.common.streams import BLOCK, Address
from tis.netem.draws.blocks import Floats, SegmentedPath
from tis.netem.stages.loss.expected_loss import ExpectedLoss

# Integers with a heavy tail: floor(X) of a Pareto II (Lomax) X, P(X >= x) = (1 + x / scale) ** -shape.
#
# Johnson, Kotz, Balakrishnan, "Continuous Univariate Distributions", vol. 1, section 20.3. Sums over the tail are
# Hurwitz zeta functions: sum_{j >= n} (1 + j / scale) ** -shape = scale ** shape * zeta(shape, scale + n).

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


class _Run(NamedTuple):
    """The run before a packet, and the number of packets left in it; 0: it has ended."""

    lost: bool
    n_left: int


@dataclass(frozen=True)
class ParetoRuns:
    """The process of a scenario's loss stage."""

    part: network.ParetoRunsLoss

    @cached_property
    def laws(self) -> tuple[FlooredLomax, FlooredLomax]:
        """Return the laws of a received and of a lost run's length, less one."""
        received, lost = self.part.received, self.part.lost
        return FlooredLomax(received.shape, received.scale), FlooredLomax(lost.shape, lost.scale)

    def blocks(self, address: Address) -> "ParetoRunsBlocks":
        """Return the loss blocks of one key."""
        return ParetoRunsBlocks(self, address)

    def expected(self, n_packets: int) -> ExpectedLoss:
        """Return the mean lost run over the mean of both (oracle: sums of probabilities, tests/netem/stages/loss).

        Of n packets none is lost if a received run has n or more left: with probability E[(R - n + 1)+] over the mean
        of both, R the length of a received run.
        """
        received, lost = (1.0 + law.mean for law in self.laws)
        if n_packets == 1:
            return ExpectedLoss(lost / (received + lost), lost)
        one, two = (self.laws[0].tail_sum(n - 1) / (received + lost) for n in (n_packets, 2 * n_packets))
        return ExpectedLoss.of_survivals(one, two)


class ParetoRunsBlocks(SegmentedPath[_Run]):
    """The losses of one key, probabilities 0 and 1.

    A run that begins at packet i has length 1 + floor(X), X from i's own uniform. A segment begins in equilibrium:
    its phase by the share of losses, the rest of its run by the law of residual lengths (Cox, "Renewal theory").
    """

    def __init__(self, loss: ParetoRuns, address: Address) -> None:
        super().__init__(self._enter, self._walk)
        self._laws = loss.laws
        self._p_loss = loss.expected(1).p_loss
        self._lengths = address.stream("loss_run")
        self._address = address

    def _enter(self, segment: int) -> _Run:
        u_phase, u_rest = self._address.stream("loss_start").uniforms(2 * segment, 2)  # the stream would keep a block
        lost = bool(u_phase < self._p_loss)
        return _Run(lost, self._laws[lost].residual(float(u_rest)))

    def _walk(self, number: int, run: _Run) -> tuple[Floats, _Run]:
        u = self._lengths.block(number)
        lengths = tuple((law.quantiles(u) + 1).tolist() for law in self._laws)
        values = np.zeros(BLOCK)
        lost, at = run.lost, run.n_left
        if lost:
            values[:at] = 1.0
        while at < BLOCK:
            lost = not lost
            end = at + lengths[lost][at]
            if lost:
                values[at:end] = 1.0
            at = end
        return values, _Run(lost, at - BLOCK)
