"""Loss: models in a file per law, all addressed by sequence number or by run time."""

from collections.abc import Mapping
from typing import Protocol

from tis.common.scenario.network import loss as network
from tis.common.streams import Address
from tis.common.trace import Trace
from tis.netem.draws.blocks import LossBlocks
from tis.netem.stages.loss import markov_loss
from tis.netem.stages.loss.expected_loss import ExpectedLoss
from tis.netem.stages.loss.gilbert_pareto import GilbertPareto
from tis.netem.stages.loss.markov_loss import Bernoulli
from tis.netem.stages.loss.pareto_runs import ParetoRuns
from tis.netem.stages.loss.trace import RecordedLoss

__all__ = ["ExpectedLoss", "expected_loss", "loss_blocks"]


class _Model(Protocol):
    """A model of loss."""

    def blocks(self, address: Address) -> LossBlocks:
        """Return the loss blocks of one key."""
        ...

    def expected(self, n_packets: int) -> ExpectedLoss:
        """Return the long-run loss of messages of ``n_packets``."""
        ...


def _model(part: network.Loss | None, traces: Mapping[str, Trace]) -> _Model:
    match part:
        case None:
            return Bernoulli(0.0)
        case network.BernoulliLoss():
            return Bernoulli(part.p_loss)
        case network.BurstLoss():
            return markov_loss.of_burst(part)
        case network.GilbertElliottLoss():
            return markov_loss.of_four_parameters(part)
        case network.FourStateLoss():
            return markov_loss.of_four_states(part)
        case network.ParetoRunsLoss():
            return ParetoRuns(part)
        case network.GilbertParetoLoss():
            return GilbertPareto(part)
        case network.TraceLoss():
            return RecordedLoss(part, traces[part.path])


def loss_blocks(part: network.Loss | None, address: Address, traces: Mapping[str, Trace]) -> LossBlocks:
    """Return the loss blocks of one key for a scenario's loss stage; None means no loss.

    ``traces`` are by the paths that the scenario names. The path of a model's state is drawn from the streams
    ``loss_state``, ``loss_run`` and ``loss_start`` of the address; the loss given that path is drawn elsewhere, from
    the stream ``loss``.
    """
    return _model(part, traces).blocks(address)


def expected_loss(part: network.Loss | None, traces: Mapping[str, Trace], n_packets: int = 1) -> ExpectedLoss:
    """Return the long-run loss of a model, exactly.

    ``n_packets`` >= 1 is the number of MTU-sized packets of each message: the model's process runs through all of
    them, and a message is lost when any of them is. A trace has one row for a message.
    """
    return _model(part, traces).expected(n_packets)
