"""Blocks of delays for one key: independent, correlated in time, or recorded."""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from tis.common.scenario.network import delay as network
from tis.common.scenario.network.pipeline import Stages
from tis.common.streams import BLOCK, Address
from tis.common.trace import Trace
from tis.netem.draws.blocks import Counts, DelayBlocks, Floats
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
        return _correlated(model, stages.correlation, address)
    return _independent(model, address)


class DrawnBlocks:
    """Delays drawn from the uniforms of delay and jitter, one draw per packet or per cell of run time."""

    def __init__(
        self,
        model: LatencyModel,
        counts: Counts,
        delay: Callable[[int, int], Floats],
        jitter: Callable[[int, int], Floats],
    ) -> None:
        self.counts = counts
        self._model, self._delay, self._jitter = model, delay, jitter

    def block(self, number: int, n: int = BLOCK) -> NDArray[np.int64]:
        """Return ``n`` delays in ns or more. Oracle: scipy.stats, tests/netem/stages/delay/test_blocks."""
        u_delay = self._delay(number, n)
        return self._model.sample(u_delay, u_delay if self._model.jitter is None else self._jitter(number, n))


def _independent(model: LatencyModel, address: Address) -> DrawnBlocks:
    return DrawnBlocks(model, "packet", address.stream("delay").block, address.stream("jitter").block)


def _correlated(model: LatencyModel, part: network.Correlation, address: Address) -> DrawnBlocks:
    """Return blocks in which delay and jitter follow one path each over run time, so that a cell has one delay."""
    delay, jitter = ScorePath(part, address, "delay"), ScorePath(part, address, "jitter")
    return DrawnBlocks(
        model,
        "cell",
        lambda number, _: uniforms(delay.block(number)),
        lambda number, _: uniforms(jitter.block(number)),
    )


class TraceBlocks:
    """The rows of a trace in order, plus jitter."""

    def __init__(self, model: LatencyModel, part: network.TraceDelay, trace: Trace, address: Address) -> None:
        self.counts: Counts = "packet" if part.advance == "packet" else "cell"
        self._model = model
        self._trace = trace
        self._delays_ns = row_delays_ns(trace)
        self._jitter = address.stream("jitter")

    def block(self, number: int, n: int = BLOCK) -> NDArray[np.int64]:
        """Return ``n`` delays in ns. Oracle: a loop over the rows, tests/netem/stages/delay/test_trace."""
        rows = rows_of_block(self._trace, self.counts, number)[:n]
        return self._model.with_jitter(self._delays_ns[rows], self._jitter.block(number, n))
