"""Reordered packets of one key, from the sequence numbers in the order of their arrival.

Order has a meaning only within a key. A repetition is a duplicate (RFC 5560) and never a reordered packet.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

SeqNumbers = NDArray[np.int64]

_MAX_N: Final = 256


def first_arrivals(seq: SeqNumbers) -> SeqNumbers:
    """Return the sequence numbers (N,) without repetitions, in the order of their first arrival."""
    _, first = np.unique(seq, return_index=True)
    return seq[np.sort(first)]


def is_reordered(seq: SeqNumbers) -> NDArray[np.bool_]:
    """Mark the packets that arrive after a later one: ``seq < NextExp`` of RFC 4737, section 3.3.

    ``seq`` (N,) holds distinct numbers in the order of arrival. NextExp is the largest number so far plus one, so
    that a loss alone reorders nothing. Oracle: the RFC's loop in the tests.
    """
    late = np.zeros(len(seq), dtype=np.bool_)
    late[1:] = seq[1:] <= np.maximum.accumulate(seq)[:-1]
    return late


def reordering_extents(seq: SeqNumbers) -> NDArray[np.int64]:
    """Return the lateness of each reordered packet, in packets, (n_reordered,), in the order of arrival.

    RFC 4737, section 4.2.1: e = i - j, j the earliest arrival with a larger number; a receiver that restores the
    order must hold so many packets. ``seq`` (N,) as in `is_reordered`. Oracle: the RFC's definition as two loops.
    """
    late = np.flatnonzero(is_reordered(seq))
    # The first arrival with a number above s is the first at which the running maximum is above s.
    earliest = np.searchsorted(np.maximum.accumulate(seq), seq[late], side="right") if len(late) else late
    return late - earliest


def n_reordering(seq: SeqNumbers) -> NDArray[np.int64]:
    """Return for each reordered packet the largest n for which it is n-reordered, (n_reordered,), 0 for none.

    RFC 4737, section 5: a packet is n-reordered when the n packets that arrived just before it all have larger
    numbers; a sender with a threshold of n duplicate acknowledgements (TCP: 3) considers it lost. Counted up to 256.
    ``seq`` (N,) as in `is_reordered`. Oracle: the RFC's definition as two loops.
    """
    late = np.flatnonzero(is_reordered(seq))
    runs = np.zeros(len(late), dtype=np.int64)
    for place, i in enumerate(late.tolist()):
        smaller = np.flatnonzero(seq[:i][::-1][:_MAX_N] < seq[i])
        runs[place] = smaller[0] if len(smaller) else min(i, _MAX_N)
    return runs
