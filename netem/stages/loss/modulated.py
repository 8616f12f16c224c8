"""Losses with a probability that depends on the state of a Markov chain with one step per packet."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from common.streams import Address
from netem.draws.blocks import BLOCK, Floats
from netem.draws.markov import MarkovChain
from netem.draws.segments import SegmentedPath
from netem.stages.loss.expected_loss import ExpectedLoss, of_message


@dataclass(frozen=True)
class ModulatedLoss:
    """A chain of n states and the loss probability in each, n numbers."""

    chain: MarkovChain
    p_loss: tuple[float, ...]

    def blocks(self, address: Address) -> "ModulatedBlocks":
        """Return the loss blocks of one key."""
        return ModulatedBlocks(self, address)

    def expected(self, n_packets: int = 1) -> ExpectedLoss:
        """Return share and mean run length from the stationary distribution pi, with e the loss in each state.

        p_loss = pi e; a run ends at a packet with probability sum_ij pi_i e_i P_ij (1 - e_j).
        Oracle: power iteration and enumeration of all paths, tests/netem/stages/loss/test_expected_loss.
        """
        e = np.array([of_message(p, n_packets) for p in self.p_loss])
        pi = self.chain.stationary
        # P (1 - e), not 1 - P e: rows of P sum to 1 only up to rounding, and certain losses must have no end
        survives = self.chain.transition @ (1.0 - e)
        return ExpectedLoss.of_rates(float(pi @ e), float((pi * e) @ survives))


class ModulatedBlocks:
    """The losses of one key: the loss probability of the chain's state at each packet."""

    counts: Literal["packet"] = "packet"

    def __init__(self, loss: ModulatedLoss, address: Address) -> None:
        self._chain = loss.chain
        self._p_loss = np.array(loss.p_loss)
        self._steps = address.stream("loss_state")
        self._starts = address.stream("loss_start")
        self._path = SegmentedPath(self._enter, self._walk)

    def block(self, number: int) -> Floats:
        """Return probabilities, (BLOCK,)."""
        return self._path.block(number)

    def _enter(self, segment: int) -> int:
        return self._chain.draw(self._starts.uniform(segment))

    def _walk(self, number: int, state: int) -> tuple[Floats, int]:
        path = self._chain.walk(self._steps.uniforms(number * BLOCK, BLOCK), state)
        return self._p_loss[path], int(path[-1])
