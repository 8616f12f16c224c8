"""Depth of a queue over time."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tis.common.metrics.percentiles import Summary

Instants = NDArray[np.int64]


def queue_depth(
    at_ns: Instants, depth: NDArray[np.int64], until_ns: int, percentiles: Sequence[int] = (50, 95, 99)
) -> Summary:
    """Return mean and percentiles of a depth over time, and its maximum; all None without samples.

    ``depth`` (N,), in packets or bytes, sampled at ``at_ns`` (N,), ascending, holds until the next sample, the last
    one until ``until_ns``. A percentile is the smallest depth that was not exceeded for at least that share of the
    time, without interpolation. The maximum is that of all samples; mean and percentiles are None where no time
    passed. Raises `ValueError` for instants that descend or that lie beyond ``until_ns``. Oracle: the depth at each
    nanosecond, written out, tests/common/metrics/test_queue_depth.
    """
    # Each depth has the weight of the time for which it holds.
    held_ns = np.diff(at_ns, append=until_ns)
    if (held_ns < 0).any() and len(at_ns):
        raise ValueError("samples must ascend in time, and none may lie beyond until_ns")
    total_ns = int(held_ns.sum()) if len(at_ns) else 0
    result: Summary = dict.fromkeys(("mean", *(f"p{p}" for p in percentiles)))
    if total_ns:
        order = np.argsort(depth, kind="stable")
        ordered, up_to_ns = depth[order], np.cumsum(held_ns[order])
        result["mean"] = float(np.average(depth, weights=held_ns))
        for p in percentiles:
            share_ns = max(-(-p * total_ns // 100), 1)  # ceil(p total / 100) in integers, as in `summarise`
            result[f"p{p}"] = float(ordered[np.searchsorted(up_to_ns, share_ns)])
    result["max"] = float(depth.max()) if len(at_ns) else None
    return result
