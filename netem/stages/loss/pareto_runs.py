"""Alternating runs of received and lost packets with heavy-tailed lengths: an alternating renewal process."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from tis.common.scenario.network import loss as network
from tis.common.streams import BLOCK, Address
from tis.netem.draws.blocks import Floats, SegmentedPath
from tis.netem.stages.loss.expected_loss import ExpectedLoss
from tis.netem.stages.loss.lomax import FlooredLomax


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
