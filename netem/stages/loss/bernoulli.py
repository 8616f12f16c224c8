"""Independent (Bernoulli) losses."""

from functools import lru_cache
from typing import Literal, Self

import numpy as np

from tis.common.streams import BLOCK, Address
from tis.netem.draws.blocks import Floats
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
