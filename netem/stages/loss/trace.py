"""The losses of a recorded trace, which repeats when it ends."""

import numpy as np
from numpy.typing import NDArray

from tis.common.scenario.network import loss as network
from tis.common.trace import Trace
from tis.common.units import NS_PER_MS
from tis.netem.draws.blocks import BLOCK, Counts, Floats
from tis.netem.stages.loss.expected_loss import ExpectedLoss
from tis.netem.stages.trace_rows import row_of_cell, row_of_packet, span_ns


class TraceBlocks:
    """Probabilities 0 and 1: packet i takes row i mod N, a cell of run time the latest row sent by then."""

    def __init__(self, part: network.TraceLoss, trace: Trace) -> None:
        self._trace = trace
        self._p_loss = _lost(trace).astype(np.float64)
        self.counts: Counts = "packet" if part.advance == "packet" else "cell"

    def block(self, number: int) -> Floats:
        """Return probabilities, (BLOCK,)."""
        indices = np.arange(number * BLOCK, (number + 1) * BLOCK)
        if self.counts == "packet":
            return self._p_loss[row_of_packet(len(self._p_loss), indices)]
        return self._p_loss[row_of_cell(self._trace, indices)]


def expected(part: network.TraceLoss, trace: Trace) -> ExpectedLoss:
    """Return the share of lost rows, or of run time, and the mean run of lost rows.

    The runs are those of one message per row; the first row follows the last one.
    """
    lost = _lost(trace)
    n_ends = int((lost & ~np.roll(lost, -1)).sum())
    by_row = ExpectedLoss.of_rates(float(lost.mean()), n_ends / len(lost))
    if part.advance == "packet":
        return by_row
    first_cells = -(-(trace.sent_ns - trace.sent_ns[0]) // NS_PER_MS)  # the first cell that begins at a row or later
    n_cells = np.diff(first_cells, append=span_ns(trace) // NS_PER_MS)
    return by_row._replace(p_loss=float(n_cells[lost].sum() / n_cells.sum()))


def _lost(trace: Trace) -> NDArray[np.bool_]:
    return trace.delay_ns < 0
