"""The row of a trace for a packet: by its sequence number, or by the run time at which it is offered."""

import numpy as np
from numpy.typing import NDArray

from tis.common.trace import Trace
from tis.common.units import NS_PER_MS


def row_of_packet(n_rows: int, seqs: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the rows of packets ``seqs``, same shape: packet i takes row i mod ``n_rows``."""
    return seqs % n_rows


def span_ns(trace: Trace) -> int:
    """Return the period of a trace that repeats, in ns: a whole number of ms, at least one.

    The last row lasts the mean interval of the rows, rounded up to the grid: so it is not skipped, and every
    repetition uses the same rows.
    """
    between = int(trace.sent_ns[-1] - trace.sent_ns[0])
    n_rows = len(trace.sent_ns)
    lasts = between * n_rows // (n_rows - 1) if n_rows > 1 else 0
    return max(1, -(-lasts // NS_PER_MS)) * NS_PER_MS


def row_of_cell(trace: Trace, cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the rows for ``cells`` of 1 ms of run time, same shape.

    It is the latest row sent at or before the beginning of the cell, modulo the period (oracle: a search row by row,
    tests/netem/stages/test_trace_rows).
    """
    instants_ns = trace.sent_ns[0] + cells * NS_PER_MS % span_ns(trace)
    return np.asarray(np.searchsorted(trace.sent_ns, instants_ns, side="right"), np.int64) - 1
