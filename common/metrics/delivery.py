"""Delivery of samples, where packets repeat samples and carry earlier ones as history."""

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]


class PlannedSamples(NamedTuple):
    """The packets of one key and their samples, by ascending sequence number.

    ``sample_ns`` (S,) holds the sample instants, ascending; ``own`` (N,) the index of each packet's own sample;
    ``is_first`` (N,) marks the first packet of each sample, before its copies.
    """

    sample_ns: Ints
    own: Ints
    is_first: Flags

    @classmethod
    def of(cls, seq: Ints, sample_ns: Ints) -> Self:
        """Return the plan of packets from their sequence numbers (N,) and sample instants (N,).

        Raises `ValueError` where the numbers do not ascend.
        """
        if (np.diff(seq) <= 0).any():
            raise ValueError("the sequence numbers of packets must ascend")
        instants, first, own = np.unique(sample_ns, return_index=True, return_inverse=True)
        is_first = np.zeros(len(seq), dtype=np.bool_)
        is_first[first] = True
        return cls(instants, own.reshape(-1), is_first)

    def carried(self, packets: Flags, history: int) -> Flags:
        """Mark the samples (S,) that the marked ``packets`` (N,) carry, each its own and the ``history`` before it.

        Oracle: a set filled packet by packet, tests/common/metrics/test_delivery.
        """
        # +1 at the first sample that a packet carries, -1 after its last; the running sum counts the carriers.
        edges = np.zeros(len(self.sample_ns) + 1, dtype=np.int64)
        own = self.own[packets]
        np.add.at(edges, np.maximum(own - history, 0), 1)
        np.add.at(edges, own + 1, -1)
        return np.asarray(np.cumsum(edges[:-1]) > 0)


def ages_at_ns(recv_ns: Ints, sample_ns: Ints, at_ns: Ints) -> Ints:
    """Return the age of the freshest sample at each instant ``at_ns`` (T,), -1 where none has arrived.

    Arrivals (N,) as in `tis.common.metrics.tick_phase.Arrivals`, both ascending; one at the same instant counts.
    """
    newest = np.searchsorted(recv_ns, at_ns, side="right") - 1  # -1: before the first arrival
    if not len(recv_ns):
        return np.full(len(at_ns), -1, dtype=np.int64)
    return np.where(newest < 0, -1, at_ns - sample_ns[newest])
