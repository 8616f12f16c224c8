"""Variation of the one-way delay by three definitions, PDV, IPDV and RTP jitter, and reordering of packets.

The definitions differ in value. The one-way delay is that of RFC 7679, between two measurement points; lost packets
have none. Order has a meaning only within a key. A repetition is a duplicate (RFC 5560) and never a reordered packet.
"""

from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

Delays = NDArray[np.int64]
Floats = NDArray[np.float64]

_GAIN: Final = 1 / 16
_CHUNK: Final = 256


def packet_delay_variation_ns(delay_ns: Delays) -> Delays:
    """Return each delay minus the smallest, (N,): PDV of RFC 5481, section 4.2 (oracle: literal table)."""
    return delay_ns - delay_ns.min() if len(delay_ns) else delay_ns


def inter_packet_delay_variation_ns(delay_ns: Delays, arrived: NDArray[np.bool_]) -> Delays:
    """Return the delay of each packet minus that of the one sent before it, where both arrived; at most (N - 1,).

    IPDV of RFC 3393 and RFC 5481, section 4.1. ``delay_ns`` (N,) and ``arrived`` (N,) hold every packet in the order
    of sending. Oracle: literal table.
    """
    both = arrived[1:] & arrived[:-1]
    return np.diff(delay_ns)[both]


def rtp_jitter_ns(sent_ns: Delays, arrived_ns: Delays) -> Floats:
    """Return the interarrival jitter of RFC 3550, section 6.4.1, after each arrival but the first, (N - 1,).

    ``J += (|D| - J) / 16``, D the difference of the transit times of a packet and the one that *arrived* before it;
    a receiver reports the last value. It is a smoothed mean of |D|, neither a standard deviation nor IPDV.
    ``sent_ns`` and ``arrived_ns`` (N,) in the order of arrival. Oracle: the RFC's loop.
    """
    if len(sent_ns) < 2:
        return np.empty(0)
    change_ns = np.abs(np.diff((arrived_ns - sent_ns).astype(np.float64)))
    n = len(change_ns)
    chunks = np.zeros((-(-n // _CHUNK), _CHUNK))
    chunks.reshape(-1)[:n] = change_ns
    back = np.subtract.outer(np.arange(_CHUNK), np.arange(_CHUNK))
    # The recursion as a matrix product within each chunk; the state at a chunk's end is then carried on.
    jitter_ns = chunks @ np.where(back < 0, 0.0, _GAIN * (1.0 - _GAIN) ** np.maximum(back, 0)).T
    faded = (1.0 - _GAIN) ** np.arange(1, _CHUNK + 1)
    for before, chunk in pairwise(jitter_ns):
        chunk += before[-1] * faded
    return np.asarray(jitter_ns.reshape(-1)[:n])


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
    order must buffer e packets. ``seq`` (N,) as in `is_reordered`. Oracle: the RFC's definition as two loops.
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
