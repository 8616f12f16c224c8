"""Runs of losses in a stream of packets (RFC 3357, loss patterns)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class LossRuns(NamedTuple):
    """The losses of N packets in the order of sending. A run is a *loss period* of the RFC."""

    n: int
    n_lost: int
    lengths: NDArray[np.int64]
    """(n_runs,): packets in each run, in order; the first and the last may be cut by the record's ends."""
    distances: NDArray[np.int64]
    """(n_lost - 1,): from each loss to the next one, in packets; 1 within a run (*loss distance*)."""

    @property
    def n_runs(self) -> int:
        """Return the number of runs."""
        return len(self.lengths)

    @property
    def mean_burst(self) -> float | None:
        """Return the mean length of the runs; None without losses."""
        return self.n_lost / self.n_runs if self.n_runs else None

    @property
    def longest(self) -> int:
        """Return the length of the longest run; 0 without losses."""
        return int(self.lengths.max(initial=0))


def loss_runs(lost: NDArray[np.bool_]) -> LossRuns:
    """Return the runs of ``lost``, (N,), in the order of sending (oracle: itertools.groupby, test_loss_runs)."""
    edges = np.flatnonzero(np.diff(lost.astype(np.int8), prepend=0, append=0))
    begins, ends = edges[::2], edges[1::2]
    at = np.flatnonzero(lost)
    return LossRuns(len(lost), len(at), ends - begins, np.diff(at))
