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
from tis.netem.stages.delay.build import latency_of
from tis.netem.stages.delay.latency import LatencyModel
from tis.netem.stages.delay.trace import row_delays_ns
from tis.netem.stages.trace_rows import row_of_cell, row_of_packet


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
        index = np.arange(number * BLOCK, (number + 1) * BLOCK)
        by_packet = self.counts == "packet"
        rows = row_of_packet(len(self._delays_ns), index) if by_packet else row_of_cell(self._trace, index)
        return self._model.with_jitter(self._delays_ns[rows], self._jitter.uniforms(number * BLOCK, BLOCK))
