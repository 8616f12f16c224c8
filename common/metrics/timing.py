"""Punctuality of the machine: lateness of ticks and releases."""

import numpy as np
from numpy.typing import NDArray

from tis.common.metrics.percentiles import Summary, summarise
from tis.common.units import NS_PER_US

Instants = NDArray[np.int64]


def lateness_us(due_ns: Instants, done_ns: Instants) -> Summary:
    """Return p50, p95, p99 and max of ``done - due`` in us; both (N,), in ns of run time.

    For ticks this is the lateness (begin - t_k), for an emulator's packets the release error (left - decided).
    """
    return summarise((done_ns - due_ns) / NS_PER_US)


def tick_summary(
    rate_hz: int, due_ns: Instants, begin_ns: Instants, missed: NDArray[np.bool_]
) -> dict[str, int | Summary]:
    """Return the summary's ``ticks``; the arrays (T,) hold every tick, including the missed ones.

    A tick is missed when it did not begin before the next one was due. It is counted but has no lateness.
    """
    begun = ~missed
    return {
        "rate_hz": rate_hz,
        "count": len(due_ns),
        "missed": int(np.count_nonzero(missed)),
        "lateness_us": lateness_us(due_ns[begun], begin_ns[begun]),
    }
