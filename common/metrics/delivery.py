"""Which samples reached the receiver at all, where packets repeat samples and carry earlier ones along."""

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]


class PlannedSamples(NamedTuple):
    """The packets of one key by what is in them, in the order of their numbers.

    ``sample_ns`` (S,) holds the instants of the samples, ascending; ``own`` (N,) the place therein of the sample that
    each packet is of, and ``is_first`` (N,) marks the first packet of each sample: its copies come later.
    """

    sample_ns: Ints
    own: Ints
    is_first: Flags

    @classmethod
    def of(cls, seq: Ints, sample_ns: Ints) -> Self:
        """Return what packets with the numbers ``seq`` (N,), ascending, hold, by the instants (N,) of their samples.

        Raises `ValueError` where the numbers do not ascend.
        """
        if (np.diff(seq) <= 0).any():
            raise ValueError("the numbers of packets must ascend")
        instants, first, own = np.unique(sample_ns, return_index=True, return_inverse=True)
        is_first = np.zeros(len(seq), dtype=np.bool_)
        is_first[first] = True
        return cls(instants, own.reshape(-1), is_first)

    def carried(self, packets: Flags, history: int) -> Flags:
        """Mark the samples (S,) that any of some packets (N,) carries: its own and the ``history`` before it.

        Oracle: a set filled packet by packet, tests/common/metrics/test_delivery.
        """
        edges = np.zeros(len(self.sample_ns) + 1, dtype=np.int64)
        own = self.own[packets]
        np.add.at(edges, np.maximum(own - history, 0), 1)
        np.add.at(edges, own + 1, -1)
        return np.asarray(np.cumsum(edges[:-1]) > 0)


def ages_at_ns(recv_ns: Ints, sample_ns: Ints, at_ns: Ints) -> Ints:
    """Return how old the freshest sample is at each instant ``at_ns`` (T,), -1 where none has arrived.

    Arrivals (N,) as in `common.metrics.tick_phase.Arrivals`, both ascending; one at the very instant counts.
    """
    newest = np.searchsorted(recv_ns, at_ns, side="right") - 1
    if not len(recv_ns):
        return np.full(len(at_ns), -1, dtype=np.int64)
    return np.where(newest < 0, -1, at_ns - sample_ns[newest])
