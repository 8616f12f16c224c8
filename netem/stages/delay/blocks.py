"""Blocks of delays for one key: independent, correlated in time, or recorded."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from tis.common.scenario.network import delay as network
from tis.common.scenario.network.pipeline import Stages
from tis.common.streams import Address
from tis.common.trace import Trace
from tis.netem.draws.blocks import BLOCK, Counts, DelayBlocks
from tis.netem.draws.correlation import ScorePath, uniforms
from tis.netem.draws.grid import rows_of_block
from tis.netem.stages.delay.latency import LatencyModel, build_jitter
from tis.netem.stages.delay.laws import ConstantDelay, Delay, own_law
from tis.netem.stages.delay.shifted import ShiftedLaw, shifted_law
from tis.netem.stages.delay.trace import EmpiricalDelay, row_delays_ns


def latency_of(stages: Stages, traces: Mapping[str, Trace]) -> LatencyModel:
    """Return the delay and jitter of stages; without a delay stage it is 0.

    ``traces`` has every trace that the stages name, by the path as written.
    """
    return LatencyModel(_law(stages, traces), None if stages.jitter is None else build_jitter(stages.jitter))


def _law(stages: Stages, traces: Mapping[str, Trace]) -> Delay:
    part = stages.delay
    if part is None:
        return ConstantDelay(0.0)
    if isinstance(part, network.TraceDelay):
        return EmpiricalDelay.of_trace(part, traces[part.path], stages.loss)
    return shifted_law(part) if isinstance(part, ShiftedLaw) else own_law(part)


def delay_blocks(stages: Stages, address: Address, traces: Mapping[str, Trace]) -> DelayBlocks:
    """Return the blocks of delays, jitter included, of a key's stages.

    A trace has its own correlation, so the correlation of the stages is ignored beside it.
    """
    model = latency_of(stages, traces)
    if isinstance(stages.delay, network.TraceDelay):
        return TraceBlocks(model, stages.delay, traces[stages.delay.path], address)
    if stages.correlation is not None:
        return CorrelatedBlocks(model, stages.correlation, address)
    return IndependentBlocks(model, address)


class IndependentBlocks:
    """Independent delays, one draw per packet."""

    counts: Counts = "packet"

    def __init__(self, model: LatencyModel, address: Address) -> None:
        self._model = model
        self._delay, self._jitter = address.stream("delay"), address.stream("jitter")

    def block(self, number: int) -> NDArray[np.int64]:
        """Return delays in ns, (BLOCK,). Oracle: scipy.stats, tests/netem/stages/delay/test_blocks."""
        u_delay = self._delay.uniforms(number * BLOCK, BLOCK)
        u_jitter = u_delay if self._model.jitter is None else self._jitter.uniforms(number * BLOCK, BLOCK)
        return self._model.sample(u_delay, u_jitter)


class CorrelatedBlocks:
    """Delay and jitter follow one path each over run time; all packets of a cell have the same delay."""

    counts: Counts = "cell"

    def __init__(self, model: LatencyModel, part: network.Correlation, address: Address) -> None:
        self._model = model
        self._delay, self._jitter = ScorePath(part, address, "delay"), ScorePath(part, address, "jitter")

    def block(self, number: int) -> NDArray[np.int64]:
        """Return delays in ns, (BLOCK,).

        Oracle: scipy.stats on distant cells, tests/netem/stages/delay/test_blocks.
        """
        u_delay = uniforms(self._delay.block(number))
        u_jitter = u_delay if self._model.jitter is None else uniforms(self._jitter.block(number))
        return self._model.sample(u_delay, u_jitter)


class TraceBlocks:
    """The rows of a trace in order, plus jitter."""

    def __init__(self, model: LatencyModel, part: network.TraceDelay, trace: Trace, address: Address) -> None:
        self.counts: Counts = "packet" if part.advance == "packet" else "cell"
        self._model = model
        self._trace = trace
        self._delays_ns = row_delays_ns(trace)
        self._jitter = address.stream("jitter")

    def block(self, number: int) -> NDArray[np.int64]:
        """Return delays in ns, (BLOCK,). Oracle: a loop over the rows, tests/netem/stages/delay/test_trace."""
        rows = rows_of_block(self._trace, self.counts, number)
        return self._model.with_jitter(self._delays_ns[rows], self._jitter.uniforms(number * BLOCK, BLOCK))
