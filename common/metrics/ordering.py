"""Reordered and duplicate packets of one key, from the sequence numbers in the order of their arrival."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

SeqNumbers = NDArray[np.int64]


class OrderCounts(NamedTuple):
    """Packets that came late, and arrivals beyond the first of each packet."""

    reordered: int
    duplicated: int


def first_arrivals(seq: SeqNumbers) -> SeqNumbers:
    """Return the sequence numbers (N,) without repetitions, in the order of their first arrival."""
    _, first = np.unique(seq, return_index=True)
    return seq[np.sort(first)]


def is_reordered(seq: SeqNumbers) -> NDArray[np.bool_]:
    """Mark the packets that come after a later one: ``seq < NextExp`` of RFC 4737, section 3.3.

    ``seq`` (N,) holds distinct numbers in the order of arrival. NextExp is the largest number so far plus
    one, so a gap by itself reorders nothing. Oracle: the RFC's loop in the tests.
    """
    late = np.zeros(len(seq), dtype=np.bool_)
    late[1:] = seq[1:] <= np.maximum.accumulate(seq)[:-1]
    return late


def order_counts(streams: Mapping[str, SeqNumbers]) -> OrderCounts:
    """Count over all keys of a link; ``streams`` maps each key to its numbers in the order of arrival.

    Order has a meaning only within a key. A repetition is a duplicate (RFC 5560) and never a reordered
    packet.
    """
    reordered = duplicated = 0
    for seq in streams.values():
        distinct = first_arrivals(seq)
        reordered += int(np.count_nonzero(is_reordered(distinct)))
        duplicated += len(seq) - len(distinct)
    return OrderCounts(reordered, duplicated)
