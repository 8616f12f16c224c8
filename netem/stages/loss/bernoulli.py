"""Independent (Bernoulli) losses."""

from typing import Literal, Self

import numpy as np

from tis.common.streams import Address
from tis.netem.draws.blocks import BLOCK, Floats
from tis.netem.stages.loss.expected_loss import ExpectedLoss, of_message


class Bernoulli:
    """Each packet is lost with probability ``p_loss``, independently of the others."""

    counts: Literal["packet"] = "packet"

    def __init__(self, p_loss: float) -> None:
        self._p_loss = p_loss
        self._block = np.full(BLOCK, p_loss)
        self._block.flags.writeable = False  # one array for all blocks

    def blocks(self, address: Address) -> Self:  # noqa: ARG002 - all keys are alike
        """Return the loss blocks of one key."""
        return self

    def block(self, number: int) -> Floats:  # noqa: ARG002 - all blocks are alike
        """Return probabilities, (BLOCK,)."""
        return self._block

    def expected(self, n_packets: int) -> ExpectedLoss:
        """Return p and 1 / (1 - p): run lengths are geometric (oracle: the binomial law, tests/netem/stages/loss)."""
        p = of_message(self._p_loss, n_packets)
        return ExpectedLoss.of_rates(p, p * (1.0 - p))
