"""Loss: which packets of a key never arrive."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.scenario import network
from netem.truncated_normal import Floats


@dataclass(frozen=True)
class BernoulliLoss:
    """Each packet is lost with probability ``p_loss``, independently: exactly none at 0, exactly all at 1."""

    p_loss: float

    def lost(self, u: Floats) -> NDArray[np.bool_]:
        """Return which packets are lost, (N,), from one uniform in (0, 1) each (oracle: the binomial law)."""
        return u < self.p_loss


def build_loss(part: network.BernoulliLoss | None) -> BernoulliLoss:
    """Return the loss that a scenario asks for; none: no packet is lost."""
    return BernoulliLoss(0.0 if part is None else part.p_loss)
