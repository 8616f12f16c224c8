"""Whether netem got the processors when it needed them, by how late packets left."""

from typing import Final

import numpy as np

from common.metrics.percentiles import summarise
from common.metrics.processor_shares import ProcessorShares
from common.units import NS_PER_MS
from deploy.logs.read.load import Ints
from deploy.report.verdict.contention import contention_clause

MIN_RELEASES: Final = 100
"""So many packets must have left before a 99th percentile says anything."""

_STARVED_P99_NS: Final = 5 * NS_PER_MS
_LATE_NS: Final = NS_PER_MS
_MAX_LATE: Final = 0.05


def starvation(error_ns: Ints, shares: ProcessorShares | None) -> str | None:
    """Return why netem could not keep up in a direction, from how late everything left (N,); None when it could.

    Starved: 99 of 100 packets did not leave within 5 ms of their instant, or more than 5 % left later than 1 ms.
    ``shares`` of netem's processors tell whose fault it was.
    """
    n = len(error_ns)
    if n < MIN_RELEASES:
        return None
    p99_ns = summarise(error_ns, (99,), ())["p99"] or 0.0
    n_late = int(np.count_nonzero(error_ns > _LATE_NS))
    if p99_ns > _STARVED_P99_NS:
        late = f"99 % of {n} packets left within {p99_ns / NS_PER_MS:.4g} ms of their instant, allowed are 5 ms"
    elif n_late > _MAX_LATE * n:
        late = f"{n_late} of {n} packets left more than 1 ms late, allowed are {_MAX_LATE:.0%}"
    else:
        return None
    return f"starved: {late}{contention_clause(shares, 'netem')}"
