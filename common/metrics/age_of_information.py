"""Age of information: how old the freshest sample at the receiver is, at every instant and not at ticks only.

Kaul, Yates and Gruteser, "Real-time status: how often should one update?" (INFOCOM 2012): the age grows with time
and falls to an update's own delay when that is fresher than all before. Peaks as in Costa, Codreanu and Ephremides
(2016).
"""

from typing import NamedTuple

import numpy as np

from common.metrics.tick_phase import Arrivals, Ints


class AgeOfInformation(NamedTuple):
    """Mean of the age over time from the first arrival on, in ns, and the age just before each update, (U,)."""

    mean_ns: float | None
    peaks_ns: Ints


def age_of_information(arrivals: Arrivals, until_ns: int) -> AgeOfInformation:
    """Return the age's mean from the first arrival until ``until_ns``, and its peaks; the open last one is none.

    The mean is the area under the saw-tooth over its length, exactly. Oracle: the age at every ns, written out.
    """
    recv_ns, sample_ns = arrivals
    before = recv_ns < until_ns
    recv_ns, sample_ns = recv_ns[before], sample_ns[before]
    peaks_ns = recv_ns[1:] - sample_ns[:-1]
    if not len(recv_ns):
        return AgeOfInformation(None, peaks_ns)
    begin = (recv_ns - sample_ns).astype(np.float64)
    end = np.append(peaks_ns, until_ns - sample_ns[-1]).astype(np.float64)
    length = np.diff(recv_ns, append=until_ns).astype(np.float64)
    area = float(np.sum((begin + end) / 2.0 * length))
    return AgeOfInformation(area / float(until_ns - recv_ns[0]), peaks_ns)
