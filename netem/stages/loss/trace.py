"""The losses of a recorded trace, which repeats when it ends."""

from typing import Self

import numpy as np

from tis.common.scenario.network import loss as network
from tis.common.streams import BLOCK, Address
from tis.common.trace import Trace
from tis.netem.draws.blocks import Counts, Floats
from tis.netem.draws.grid import cells_of_rows, rows_of_block
from tis.netem.stages.loss.expected_loss import ExpectedLoss


class RecordedLoss:
    """Probabilities 0 and 1: packet i takes row i mod N, a cell of run time the latest row sent by then."""

    def __init__(self, part: network.TraceLoss, trace: Trace) -> None:
        self.counts: Counts = "packet" if part.advance == "packet" else "cell"
        self._trace = trace
        self._lost = trace.delay_ns < 0
        self._p_loss = self._lost.astype(np.float64)

    def blocks(self, address: Address) -> Self:  # noqa: ARG002 - all keys are alike
        """Return the loss blocks of one key."""
        return self

    def block(self, number: int, n: int = BLOCK) -> Floats:
        """Return probabilities, (n,)."""
        return self._p_loss[rows_of_block(self._trace, self.counts, number)[:n]]

    def expected(self, n_packets: int) -> ExpectedLoss:  # noqa: ARG002 - a message is one row
        """Return the share of lost rows, or of run time, and the mean run of lost rows.

        The runs are those of one message per row; the first row follows the last one.
        """
        lost = self._lost
        n_ends = int((lost & ~np.roll(lost, -1)).sum())
        by_row = ExpectedLoss.of_rates(float(lost.mean()), n_ends / len(lost))
        if self.counts == "packet":
            return by_row
        n_cells = cells_of_rows(self._trace)
        return by_row._replace(p_loss=float(n_cells[lost].sum() / n_cells.sum()))
