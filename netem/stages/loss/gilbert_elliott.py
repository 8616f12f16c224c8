"""The Gilbert-Elliott model: two states, good and bad, each with its own loss probability.

Gilbert, "Capacity of a burst-noise channel", 1960; Elliott, "Estimates of error rates for codes on burst-noise
channels", 1963. In their notation p is the transition to bad, r to good, 1 - k the loss in good, 1 - h in bad.
"""

import numpy as np

from tis.common.scenario.network import loss as network
from tis.netem.draws.markov import MarkovChain
from tis.netem.stages.loss.modulated import ModulatedLoss


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
