"""Losses with a probability that depends on the state of a Markov chain with one step per packet."""

from dataclasses import dataclass

import numpy as np

from tis.common.streams import Address
from tis.netem.draws.blocks import Floats, SegmentedPath
from tis.netem.draws.markov import MarkovChain
from tis.netem.stages.loss.expected_loss import ExpectedLoss


@dataclass(frozen=True)
class ModulatedLoss:
    """A chain of n states and the loss probability in each, n numbers."""

    chain: MarkovChain
    p_loss: tuple[float, ...]

    def blocks(self, address: Address) -> "ModulatedBlocks":
        """Return the loss blocks of one key."""
        return ModulatedBlocks(self, address)

    def expected(self, n_packets: int = 1) -> ExpectedLoss:
        """Return share and mean run length of messages of ``n_packets``, from the stationary distribution pi.

        With e the loss in each state and A = diag(1 - e) P, a message is lost with probability pi (1 + A + .. + A **
        (n - 1)) e, and a run ends behind it with (pi - pi A ** n) A ** (n - 1) (1 - e). Only positive terms are
        added, so that rare losses keep their digits.
        Oracle: power iteration and enumeration of all paths, tests/netem/stages/loss/test_expected_loss.
        """
        e, pi, P = np.array(self.p_loss), self.chain.stationary, self.chain.transition
        if n_packets == 1:
            # P (1 - e), not 1 - P e: rows of P sum to 1 only up to rounding, and certain losses must have no end
            return ExpectedLoss.of_rates(float(pi @ e), float((pi * e) @ (P @ (1.0 - e))))
        A = (1.0 - e)[:, None] * P
        last = np.linalg.matrix_power(A, n_packets - 1)
        p_loss = float(pi @ _geometric_sum(A, n_packets) @ e)
        return ExpectedLoss.of_rates(p_loss, float((pi - pi @ last @ A) @ last @ (1.0 - e)))


def _geometric_sum(A: Floats, n: int) -> Floats:
    """Return 1 + A + .. + A ** (n - 1), n >= 1, by doubling."""
    if n == 1:
        return np.eye(len(A))
    half = _geometric_sum(A, n // 2)
    whole = half + np.linalg.matrix_power(A, n // 2) @ half
    return whole + np.linalg.matrix_power(A, n - 1) if n % 2 else whole


class ModulatedBlocks(SegmentedPath[int]):
    """The losses of one key: the loss probability of the chain's state at each packet."""

    def __init__(self, loss: ModulatedLoss, address: Address) -> None:
        super().__init__(self._enter, self._walk)
        self._chain = loss.chain
        self._p_loss = np.array(loss.p_loss)
        self._steps = address.stream("loss_state")
        self._address = address

    def _enter(self, segment: int) -> int:
        return self._chain.draw(self._address.stream("loss_start").uniform(segment))  # the stream would keep a block

    def _walk(self, number: int, state: int) -> tuple[Floats, int]:
        path = self._chain.walk(self._steps.block(number), state)
        return self._p_loss[path], int(path[-1])
