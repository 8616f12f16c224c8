"""The Gilbert-Pareto model of the fault injector NetFI: good and bad states with heavy-tailed bursts.

Zhang, Roodabeh, Alemzadeh, "A comprehensive analysis of the effects of network quality of service on robotic
telesurgery", ICRA 2026, arXiv 2603.06824. A hidden chain takes one step per packet. A packet outside a burst draws
K = floor(X), X Pareto II with the parameters of the chain's state: K packets are lost, this one first, and the next
one is received. K is often 0. So the stream is a sequence of cycles of K + 1 packets, each with a received last one.
"""

from dataclasses import dataclass
from functools import cached_property
from math import log
from typing import Final, NamedTuple

import numpy as np

from tis.common.scenario.network import loss as network
from tis.common.streams import BLOCK, Address
from tis.netem.draws.blocks import Floats, SegmentedPath
from tis.netem.draws.markov import MarkovChain
from tis.netem.stages.loss.expected_loss import ExpectedLoss
from tis.netem.stages.loss.pareto_runs import MAX_RUN, FlooredLomax

_NEGLIGIBLE: Final = 1e-15


class _Place(NamedTuple):
    """The state before a packet: the chain's state, the losses left, and whether a certain arrival follows them."""

    state: int
    n_lost_left: int
    in_cycle: bool


@dataclass(frozen=True)
class GilbertPareto:
    """The process of a scenario's loss stage."""

    part: network.GilbertParetoLoss

    @cached_property
    def chain(self) -> MarkovChain:
        """Return the hidden chain; state 1 is bad."""
        p, r = self.part.p_bad, self.part.p_good
        return MarkovChain(np.array([[1.0 - p, p], [r, 1.0 - r]]))

    @cached_property
    def laws(self) -> tuple[FlooredLomax, FlooredLomax]:
        """Return the laws of K in good and in bad."""
        good, bad = self.part.good, self.part.bad
        return FlooredLomax(good.shape, good.scale), FlooredLomax(bad.shape, bad.scale)

    @cached_property
    def cycles(self) -> Floats:
        """Return the share of cycles drawn in good and in bad, (2,): the chain observed at the draws only.

        Between two draws the chain takes K + 1 steps, which leave x ** (K + 1) of its memory, x = 1 - p - r. So it
        moves to bad with probability pi_bad (1 - E[x ** (K + 1)]), K as in good, and back likewise; summation by
        parts gives 1 - E[x ** (K + 1)] = (1 - x) sum_{k >= 0} P(K >= k) x ** k.
        """
        x = 1.0 - self.part.p_bad - self.part.p_good
        in_good, in_bad = (_discounted(law, x) for law in self.laws)
        to_good, to_bad = self.chain.stationary * np.array([in_bad, in_good])
        shares: Floats = np.array([to_good, to_bad]) / (to_good + to_bad)
        return shares

    def blocks(self, address: Address) -> "GilbertParetoBlocks":
        """Return the loss blocks of one key."""
        return GilbertParetoBlocks(self, address)

    def expected(self, n_packets: int) -> ExpectedLoss:
        """Return E[K] / (1 + E[K]) and E[K | K > 0] over the cycles.

        Of n packets none is lost if the first one ends a cycle, and n - 1 cycles with K = 0 follow: the chain takes
        one step with each. Oracle: a walk by packets, tests/netem/stages/loss.
        """
        cycles = self.cycles
        mean = float(cycles @ [law.mean for law in self.laws])
        if n_packets > 1:
            none = np.array([1.0 - law.at_least(1) for law in self.laws])
            steps = none[:, None] * self.chain.transition

            def survival(n: int) -> float:
                return float(cycles @ np.linalg.matrix_power(steps, n - 2) @ none) / (1.0 + mean)

            return ExpectedLoss.of_survivals(survival(n_packets), survival(2 * n_packets))
        p_some = float(cycles @ [law.at_least(1) for law in self.laws])
        return ExpectedLoss(mean / (1.0 + mean), mean / p_some)


def _discounted(law: FlooredLomax, x: float) -> float:
    """Return sum_{k >= 0} P(K >= k) x ** k, -1 <= x <= 1."""
    n_terms = MAX_RUN if abs(x) == 1 else min(MAX_RUN, 2 + int(log(_NEGLIGIBLE) / log(max(abs(x), _NEGLIGIBLE))))
    k = np.arange(n_terms)
    return float(np.sum((1.0 + k / law.scale) ** -law.shape * x**k))


class GilbertParetoBlocks(SegmentedPath[_Place]):
    """The losses of one key, probabilities 0 and 1; segments begin in equilibrium."""

    def __init__(self, loss: GilbertPareto, address: Address) -> None:
        super().__init__(self._enter, self._walk)
        self._chain, self._laws, self._cycles = loss.chain, loss.laws, loss.cycles
        self._steps = address.stream("loss_state")
        self._lengths = address.stream("loss_run")
        self._address = address

    def _enter(self, segment: int) -> _Place:
        starts = self._address.stream("loss_start").uniforms(4 * segment, 4).tolist()  # the stream would keep a block
        u_drawn, u_length, u_position, u_state = starts
        # the state in which the cycle of the packet before the segment was drawn, weighted by the cycle's length
        packets = self._cycles * [1.0 + law.mean for law in self._laws]
        drawn = int(u_drawn >= packets[0] / packets.sum())
        n_lost = self._laws[drawn].length_biased(u_length)
        position = min(n_lost, int(u_position * (n_lost + 1)))
        p_bad_now = self._chain.after(drawn, position)[1]
        return _Place(int(u_state < p_bad_now), max(0, n_lost - position - 1), position < n_lost)

    def _walk(self, number: int, place: _Place) -> tuple[Floats, _Place]:
        states = self._chain.walk(self._steps.block(number), place.state)
        u = self._lengths.block(number)
        n_lost = np.where(states, self._laws[1].quantiles(u), self._laws[0].quantiles(u))
        values = np.zeros(BLOCK)
        values[: place.n_lost_left] = 1.0  # the rest of the burst before this block
        end, free = place.n_lost_left, place.n_lost_left + place.in_cycle
        begins = np.flatnonzero(n_lost)
        for at, n in zip(begins.tolist(), n_lost[begins].tolist(), strict=True):
            if at >= free:
                end = at + n
                values[at:end] = 1.0
                free = end + 1
        return values, _Place(int(states[-1]), max(0, end - BLOCK), free > BLOCK)
