"""Loss: one file per model, all addressed by sequence number or by run time."""

from collections.abc import Mapping

from tis.common.scenario.network import loss as network
from tis.common.streams import Address
from tis.common.trace import Trace
from tis.netem.draws.blocks import LossBlocks
from tis.netem.stages.loss import bernoulli, four_state, gilbert_elliott, gilbert_pareto, pareto_runs, trace
from tis.netem.stages.loss.expected_loss import ExpectedLoss

__all__ = ["ExpectedLoss", "expected_loss", "loss_blocks"]


def loss_blocks(part: network.Loss | None, address: Address, traces: Mapping[str, Trace]) -> LossBlocks:
    """Return the loss blocks of one key for a scenario's loss stage; None means no loss.

    ``traces`` are by the paths that the scenario names. The path of a model's state is drawn from the streams
    ``loss_state``, ``loss_run`` and ``loss_start`` of the address; the loss given that path is drawn elsewhere, from
    the stream ``loss``.
    """
    match part:
        case None:
            return bernoulli.BernoulliBlocks(0.0)
        case network.BernoulliLoss():
            return bernoulli.BernoulliBlocks(part.p_loss)
        case network.BurstLoss():
            return gilbert_elliott.of_burst(part).blocks(address)
        case network.GilbertElliottLoss():
            return gilbert_elliott.of_four_parameters(part).blocks(address)
        case network.FourStateLoss():
            return four_state.of(part).blocks(address)
        case network.ParetoRunsLoss():
            return pareto_runs.ParetoRunsBlocks(part, address)
        case network.GilbertParetoLoss():
            return gilbert_pareto.GilbertParetoBlocks(part, address)
        case network.TraceLoss():
            return trace.TraceBlocks(part, traces[part.path])


def expected_loss(part: network.Loss | None, traces: Mapping[str, Trace], n_packets: int = 1) -> ExpectedLoss:
    """Return the long-run loss of a model, exactly.

    ``n_packets`` >= 1 is the number of MTU-sized packets of each message: the model's process runs through all of
    them, and a message is lost when any of them is. A trace has one row for a message.
    """
    match part:
        case None:
            return bernoulli.expected(0.0, n_packets)
        case network.BernoulliLoss():
            return bernoulli.expected(part.p_loss, n_packets)
        case network.BurstLoss():
            return gilbert_elliott.of_burst(part).expected(n_packets)
        case network.GilbertElliottLoss():
            return gilbert_elliott.of_four_parameters(part).expected(n_packets)
        case network.FourStateLoss():
            return four_state.of(part).expected(n_packets)
        case network.ParetoRunsLoss():
            return pareto_runs.expected(part, n_packets)
        case network.GilbertParetoLoss():
            return gilbert_pareto.expected(part, n_packets)
        case network.TraceLoss():
            return trace.expected(part, traces[part.path])
