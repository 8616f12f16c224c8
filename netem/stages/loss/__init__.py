"""Loss: which packets of a key never arrive. One file a model; all are addressed by sequence number or run time."""

from collections.abc import Mapping

from common.scenario.network import loss as network
from common.streams import Address
from common.trace import Trace
from netem.draws.blocks import LossBlocks
from netem.stages.loss import bernoulli, four_state, gilbert_elliott, gilbert_pareto, pareto_runs, trace
from netem.stages.loss.expected_loss import ExpectedLoss

__all__ = ["ExpectedLoss", "expected_loss", "loss_blocks"]


def loss_blocks(part: network.Loss | None, address: Address, traces: Mapping[str, Trace]) -> LossBlocks:
    """Return the loss of one key as a scenario asks for it; none: no packet is lost.

    ``traces`` by the paths that scenarios name. The path of a model's state is drawn from the address' streams
    ``loss_state``, ``loss_run`` and ``loss_start``; whether a packet is lost, given that path, from ``loss``,
    which nothing here touches.
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
    """Return what a loss model loses in the long run, exactly.

    ``n_packets`` >= 1 is how many packets of an MTU a message has: it is lost when one of them is, each with the
    probability of the state that holds for the message.
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
            return pareto_runs.expected(part)
        case network.GilbertParetoLoss():
            return gilbert_pareto.expected(part)
        case network.TraceLoss():
            return trace.expected(part, traces[part.path])
