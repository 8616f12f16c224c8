"""What the tests of the loss models share: parts, losses, and the models again as one big Markov chain."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from tis.common.scenario.network import loss as network
from tis.common.streams import BLOCK, Address
from tis.netem.stages.loss import loss_blocks

HERE = Address(5, "forward", "tis/MTML/measured_cp")
_LOSS: TypeAdapter[network.Loss] = TypeAdapter(network.Loss)

Floats = NDArray[np.float64]


def make(kind: str, **fields: Any) -> network.Loss:
    return _LOSS.validate_python({"kind": kind, **fields})


def netfi(good: tuple[float, float], bad: tuple[float, float]) -> network.Loss:
    law = [{"shape": shape, "scale": scale} for shape, scale in (good, bad)]
    return make("gilbert_pareto", p_bad=0.05, p_good=0.10, good=law[0], bad=law[1])


def losses(part: network.Loss | None, n_blocks: int, address: Address = HERE) -> NDArray[np.bool_]:
    """Which of the first packets are lost, as netem decides it: by the uniforms of the stream ``loss``."""
    blocks, stream = loss_blocks(part, address, {}), address.stream("loss")
    return np.concatenate(
        [stream.uniforms(number * BLOCK, BLOCK) < blocks.block(number) for number in range(n_blocks)]
    )


@dataclass(frozen=True)
class BigChain:
    """A chain whose states say whether the packet is lost, and whether it is the first of a run of losses."""

    P: Floats
    lost: Floats
    begins: Floats

    @cached_property
    def stationary(self) -> Floats:
        P = (self.P + np.eye(len(self.P))) / 2  # lazy, so that a period does no harm
        for _ in range(40):  # power iteration by squaring: 2**40 steps
            P = P @ P
            P /= P.sum(axis=1, keepdims=True)
        return np.asarray(P[0])

    def std_of_mean(self, f: Floats) -> float:
        """Limit of sqrt(N) times the standard deviation of the mean of f over N packets (fundamental matrix)."""
        pi = self.stationary
        f = f - pi @ f
        Z = np.linalg.inv(np.eye(len(pi)) - self.P + pi)
        return float(np.sqrt(2 * (pi * f) @ Z @ f - (pi * f) @ f))

    def p_loss(self) -> float:
        return float(self.stationary @ self.lost)

    def mean_burst(self) -> float:
        return self.p_loss() / float(self.stationary @ self.begins)

    def std_of_burst(self) -> float:
        """The same for losses over runs, by the delta method."""
        f = self.lost - self.mean_burst() * self.begins
        return self.std_of_mean(f) / float(self.stationary @ self.begins)

    def run_law(self, n: int) -> Floats:
        """P(run = 1), P(run = 2), .., P(run = n), step by step."""
        here = self.stationary * self.begins
        here /= here.sum()
        law = []
        for _ in range(n):
            following = here @ self.P
            law.append(float(following @ (1 - self.lost)))
            here = following * self.lost
        return np.array(law)


def of_states(P: Floats, e: Floats) -> BigChain:
    """States (lost before, state, lost now) of a chain P whose state i loses a packet with probability e_i."""
    n = len(P)
    outcome = np.stack([1 - e, e], axis=1)  # (state, lost now)
    step = np.einsum("ij,jb->ijb", P, outcome).reshape(n, 2 * n)  # state -> (state, lost now)
    big = np.zeros((2, n, 2, 2, n, 2))
    for now in range(2):
        big[:, :, now, now] = step.reshape(n, n, 2)
    before, _, now_lost = np.meshgrid(range(2), range(n), range(2), indexing="ij")
    P_big = big.reshape(4 * n, 4 * n)
    entered = P_big.sum(axis=0) > 0
    begins = (now_lost == 1) & (before == 0)
    return BigChain(
        P_big[np.ix_(entered, entered)],
        now_lost.ravel()[entered].astype(float),
        begins.ravel()[entered].astype(float),
    )


def big_chain(part: network.Loss, longest: int = 60) -> BigChain:
    """Return a model as it is defined, packet by packet; runs beyond ``longest`` are left out."""
    match part:
        case network.BernoulliLoss():
            return of_states(np.ones((1, 1)), np.array([part.p_loss]))
        case network.BurstLoss():
            r = 1 / part.mean_burst
            p = r * part.p_loss / (1 - part.p_loss)
            return of_states(np.array([[1 - p, p], [r, 1 - r]]), np.array([0.0, 1.0]))
        case network.GilbertElliottLoss():
            p, r = part.p_bad, part.p_good
            return of_states(np.array([[1 - p, p], [r, 1 - r]]), np.array([part.p_loss_good, part.p_loss_bad]))
        case network.FourStateLoss():
            P = np.array(
                [
                    [1 - part.p13 - part.p14, 0, part.p13, part.p14],
                    [0, 1 - part.p23, part.p23, 0],
                    [part.p31, part.p32, 1 - part.p31 - part.p32, 0],
                    [1, 0, 0, 0],
                ]
            )
            return of_states(P, np.array([0.0, 0, 1, 1]))
        case network.GilbertParetoLoss():
            return _of_gilbert_pareto(part, longest)
        case _:
            raise NotImplementedError


def lomax_pmf(shape: float, scale: float, n: int) -> Floats:
    """P(floor(X) = 0), .., P(floor(X) = n - 1); the last one takes the rest."""
    at_least = (1 + np.arange(n) / scale) ** -shape
    return np.append(at_least[:-1] - at_least[1:], at_least[-1])


def _of_gilbert_pareto(part: network.GilbertParetoLoss, longest: int) -> BigChain:
    """States (good or bad, losses due at this packet and after it); the injector's own loop, packet by packet."""
    laws = [lomax_pmf(law.shape, law.scale, longest) for law in (part.good, part.bad)]
    hidden = np.array([[1 - part.p_bad, part.p_bad], [part.p_good, 1 - part.p_good]])
    P = np.zeros((2, longest, 2, longest))
    for state in range(2):
        for following in range(2):
            P[state, 0, following] = hidden[state, following] * laws[following]
            for due in range(1, longest):
                P[state, due, following, due - 1] = hidden[state, following]
    return of_states(P.reshape(2 * longest, 2 * longest), np.tile(np.arange(longest) > 0, 2).astype(float))
