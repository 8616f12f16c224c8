"""Variation of the one-way delay by three common definitions, PDV, IPDV and RTP jitter, which differ in value.

The one-way delay is that of RFC 7679, between two measurement points; lost packets have none.
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
