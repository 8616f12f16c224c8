"""Age of information: the age of the receiver's freshest sample over continuous time.

Kaul, Yates and Gruteser, "Real-time status: how often should one update?" (INFOCOM 2012): the age grows with time
and falls to the delay of each update that is fresher than all before. Peaks: Costa, Codreanu and Ephremides (2016).
"""

from typing import NamedTuple

import numpy as np

from tis.common.metrics.tick_phase import Arrivals, Ints


class AgeOfInformation(NamedTuple):
    """Time average of the age from the first arrival on, in ns, and the age just before each update, (U,)."""

    mean_ns: float | None
    peaks_ns: Ints


def age_of_information(arrivals: Arrivals, until_ns: int) -> AgeOfInformation:
    """Return mean and peaks of the age from the first arrival until ``until_ns``; its last rise has no peak.

    The mean is the exact area under the saw-tooth over its length. Oracle: the age at every ns, written out.
    """
    recv_ns, sample_ns = arrivals
    before = recv_ns < until_ns
    recv_ns, sample_ns = recv_ns[before], sample_ns[before]
    peaks_ns = recv_ns[1:] - sample_ns[:-1]
    if not len(recv_ns):
        return AgeOfInformation(None, peaks_ns)
    # Trapezoids between arrivals: the age rises from an update's delay to the peak before the next update.
    begin = (recv_ns - sample_ns).astype(np.float64)
    end = np.append(peaks_ns, until_ns - sample_ns[-1]).astype(np.float64)
    length = np.diff(recv_ns, append=until_ns).astype(np.float64)
    area = float(np.sum((begin + end) / 2.0 * length))
    return AgeOfInformation(area / float(until_ns - recv_ns[0]), peaks_ns)
