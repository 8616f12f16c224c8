"""The long-run loss of a model: share of messages and mean burst length."""

from math import inf
from typing import NamedTuple, Self


class ExpectedLoss(NamedTuple):
    """``p_loss``: share of messages lost; ``mean_burst``: mean length of runs of losses, 0 without losses."""

    p_loss: float
    mean_burst: float

    @classmethod
    def of_rates(cls, p_loss: float, p_end: float) -> Self:
        """Return the result from the share of lost messages and the share of lost messages that end a run.

        Each run has one end, so the mean length is the ratio of the two; without an end it is infinite.
        """
        if p_loss == 0:
            return cls(0.0, 0.0)
        return cls(p_loss, p_loss / p_end if p_end > 0 else inf)

    @classmethod
    def of_survivals(cls, one: float, two: float) -> Self:
        """Return the result from the probabilities that one message, and that two in a row, lose no packet.

        A run of lost messages ends at a received one that follows a lost one, with probability ``one - two``.
        """
        return cls.of_rates(1.0 - one, one - two)


def of_message(p_packet: float, n_packets: int) -> float:
    """Return the probability that any of ``n_packets`` is lost, each with probability ``p_packet``."""
    return p_packet if n_packets == 1 else float(1.0 - (1.0 - p_packet) ** n_packets)
