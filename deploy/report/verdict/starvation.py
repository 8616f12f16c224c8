"""Starvation of netem, detected from the release error."""

from typing import Final

import numpy as np

from tis.common.metrics.percentiles import summarise
from tis.common.metrics.processor_shares import ProcessorShares
from tis.common.units import NS_PER_MS
from tis.deploy.logs.read.load import Ints
from tis.deploy.report.verdict.contention import contention_clause

MIN_RELEASES: Final = 100
"""Fewest packets for a 99th percentile."""

_STARVED_P99_NS: Final = 5 * NS_PER_MS
_LATE_NS: Final = NS_PER_MS
_MAX_LATE: Final = 0.05


def starvation(error_ns: Ints, shares: ProcessorShares | None) -> str | None:
    """Return the problem of a starved netem from the release errors (N,) of a direction; None when it kept up.

    Starved: the 99th percentile of the release error exceeds 5 ms, or more than 5 % of packets left over 1 ms late.
    ``shares`` of netem's processors name the cause.
    """
    n = len(error_ns)
    if n < MIN_RELEASES:
        return None
    p99_ns = summarise(error_ns, (99,), ())["p99"] or 0.0
    n_late = int(np.count_nonzero(error_ns > _LATE_NS))
    if p99_ns > _STARVED_P99_NS:
        late = f"1 % of {n} packets left netem more than {p99_ns / NS_PER_MS:.4g} ms late, allowed are 5 ms"
    elif n_late > _MAX_LATE * n:
        late = f"{n_late} of {n} packets left more than 1 ms late, allowed are {_MAX_LATE:.0%}"
    else:
        return None
    return f"starved: {late}{contention_clause(shares, 'netem')}"
