"""The four-state model: 1 received, 2 received within a burst, 3 lost within a burst, 4 isolated loss.

Salsano, Ludovici, Ordine, Giannuzzi, "Definition of a general and intuitive loss model for packet networks and its
implementation in the Netem module in the Linux kernel", 2012.
"""

import numpy as np

from tis.common.scenario.network import loss as network
from tis.netem.draws.markov import MarkovChain
from tis.netem.stages.loss.modulated import ModulatedLoss


def of(part: network.FourStateLoss) -> ModulatedLoss:
    """Return the model; state 4 always returns to 1 (oracle: the paper's P_loss, tests/netem/stages/loss)."""
    transition = np.zeros((4, 4))
    transition[0, 2:] = part.p13, part.p14
    transition[1, 2] = part.p23
    transition[2, :2] = part.p31, part.p32
    transition[3, 0] = 1.0
    stays = np.maximum(0.0, 1.0 - transition.sum(axis=1))
    return ModulatedLoss(MarkovChain(transition + np.diag(stays)), (0.0, 0.0, 1.0, 1.0))
