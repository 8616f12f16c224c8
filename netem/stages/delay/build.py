"""Construction of the delay model from a scenario's stages."""

from collections.abc import Mapping

import numpy as np

from tis.common.scenario.network import delay as network
from tis.common.scenario.network.pipeline import Stages
from tis.common.trace import Trace
from tis.common.units import NS_PER_MS
from tis.netem.stages.delay.constant import ConstantDelay
from tis.netem.stages.delay.gamma import Gamma
from tis.netem.stages.delay.hyperexponential import Hyperexponential
from tis.netem.stages.delay.jitter import build_jitter
from tis.netem.stages.delay.latency import LatencyModel
from tis.netem.stages.delay.law import Delay
from tis.netem.stages.delay.lognormal import Lognormal
from tis.netem.stages.delay.normal import NormalDelay
from tis.netem.stages.delay.pareto import Lomax
from tis.netem.stages.delay.quantiles import QuantileDelay
from tis.netem.stages.delay.shifted import Part, ShiftedDelay
from tis.netem.stages.delay.trace import EmpiricalDelay
from tis.netem.stages.delay.uniform import UniformDelay

_Unbounded = network.LognormalDelay | network.GammaDelay | network.ParetoDelay | network.HyperexponentialDelay


def latency_of(stages: Stages, traces: Mapping[str, Trace]) -> LatencyModel:
    """Return the delay and jitter of stages; without a delay stage it is 0.

    ``traces`` has every trace that the stages name, by the path as written.
    """
    return LatencyModel(_law(stages, traces), None if stages.jitter is None else build_jitter(stages.jitter))


def _law(stages: Stages, traces: Mapping[str, Trace]) -> Delay:
    match stages.delay:
        case None:
            return ConstantDelay(0.0)
        case network.ConstantDelay(delay_ms=delay_ms):
            return ConstantDelay(delay_ms * NS_PER_MS)
        case network.UniformDelay(low_ms=low_ms, high_ms=high_ms):
            return UniformDelay(low_ms * NS_PER_MS, high_ms * NS_PER_MS)
        case network.NormalDelay(mean_ms=mean_ms, std_ms=std_ms):
            return NormalDelay(mean_ms * NS_PER_MS, std_ms * NS_PER_MS)
        case network.QuantileDelay(points=points):
            delays_ns = np.array([point.delay_ms for point in points]) * NS_PER_MS
            return QuantileDelay(np.array([point.p for point in points]), delays_ns)
        case network.TraceDelay() as part:
            return EmpiricalDelay.of_trace(part, traces[part.path], stages.loss)
        case part:
            return ShiftedDelay(_part(part), part.shift_ms * NS_PER_MS, part.max_ms * NS_PER_MS)


def _part(delay: _Unbounded) -> Part:
    match delay:
        case network.LognormalDelay(mean_ms=mean_ms, std_ms=std_ms):
            return Lognormal.of_moments(mean_ms * NS_PER_MS, std_ms * NS_PER_MS)
        case network.GammaDelay(mean_ms=mean_ms, std_ms=std_ms):
            return Gamma.of_moments(mean_ms * NS_PER_MS, std_ms * NS_PER_MS)
        case network.ParetoDelay(scale_ms=scale_ms, shape=shape):
            return Lomax(shape, scale_ms * NS_PER_MS)
        case network.HyperexponentialDelay(weights=weights, means_ms=means_ms):
            total = sum(weights)  # a scenario's weights sum to 1 only up to rounding
            return Hyperexponential(
                tuple(weight / total for weight in weights), tuple(mean_ms * NS_PER_MS for mean_ms in means_ms)
            )
