"""Losses without memory and by a Markov chain: Bernoulli, Gilbert-Elliott and four states, one step per packet."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, Self

import numpy as np

from tis.common.scenario.network import loss as network
from tis.common.streams import BLOCK, Address
from tis.netem.draws.blocks import Floats, SegmentedPath
from tis.netem.draws.markov import MarkovChain
from tis.netem.stages.loss.expected_loss import ExpectedLoss, of_message


class Bernoulli:
    """Each packet is lost with probability ``p_loss``, independently of the others."""

    counts: Literal["packet"] = "packet"

    def __init__(self, p_loss: float) -> None:
        self._p_loss = p_loss
        self._block = _constant(p_loss)

    def blocks(self, address: Address) -> Self:  # noqa: ARG002 - all keys are alike
        """Return the loss blocks of one key."""
        return self

    def block(self, number: int, n: int = BLOCK) -> Floats:  # noqa: ARG002 - all blocks are alike
        """Return probabilities, (BLOCK,)."""
        return self._block

    def expected(self, n_packets: int) -> ExpectedLoss:
        """Return p and 1 / (1 - p): run lengths are geometric (oracle: the binomial law, tests/netem/stages/loss)."""
        p = of_message(self._p_loss, n_packets)
        return ExpectedLoss.of_rates(p, p * (1.0 - p))


@lru_cache(maxsize=64)
def _constant(p: float) -> Floats:
    """Return one array for all blocks of all keys, (BLOCK,)."""
    block = np.full(BLOCK, p)
    block.flags.writeable = False
    return block


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


# The four-state model: 1 received, 2 received within a burst, 3 lost within a burst, 4 isolated loss.
#
# Salsano, Ludovici, Ordine, Giannuzzi, "Definition of a general and intuitive loss model for packet networks and its
# implementation in the Netem module in the Linux kernel", 2012.


def of_four_states(part: network.FourStateLoss) -> ModulatedLoss:
    """Return the model; state 4 always returns to 1 (oracle: the paper's P_loss, tests/netem/stages/loss)."""
    transition = np.zeros((4, 4))
    transition[0, 2:] = part.p13, part.p14
    transition[1, 2] = part.p23
    transition[2, :2] = part.p31, part.p32
    transition[3, 0] = 1.0
    stays = np.maximum(0.0, 1.0 - transition.sum(axis=1))
    return ModulatedLoss(MarkovChain(transition + np.diag(stays)), (0.0, 0.0, 1.0, 1.0))


# The Gilbert-Elliott model: two states, good and bad, each with its own loss probability.
#
# Gilbert, "Capacity of a burst-noise channel", 1960; Elliott, "Estimates of error rates for codes on burst-noise
# channels", 1963. In their notation p is the transition to bad, r to good, 1 - k the loss in good, 1 - h in bad.


def of_four_parameters(part: network.GilbertElliottLoss) -> ModulatedLoss:
    """Return the model with its four parameters."""
    return _two_states(part.p_bad, part.p_good, part.p_loss_good, part.p_loss_bad)


def of_burst(part: network.BurstLoss) -> ModulatedLoss:
    """Return Gilbert's model, which loses all packets in bad and none in good, from two measurable figures.

    With mean loss L and mean run length B: r = 1 / B, p = r L / (1 - L).
    """
    r = 1.0 / part.mean_burst
    return _two_states(min(1.0, r * part.p_loss / (1.0 - part.p_loss)), r, 0.0, 1.0)


def _two_states(p: float, r: float, p_loss_good: float, p_loss_bad: float) -> ModulatedLoss:
    return ModulatedLoss(MarkovChain(np.array([[1.0 - p, p], [r, 1.0 - r]])), (p_loss_good, p_loss_bad))
