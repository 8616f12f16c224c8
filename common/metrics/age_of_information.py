"""Age of information: the age of the receiver's freshest sample, over continuous time and at the ticks of a phase.

Kaul, Yates and Gruteser, "Real-time status: how often should one update?" (INFOCOM 2012): the age grows with time
and falls to the delay of each update that is fresher than all before. Peaks: Costa, Codreanu and Ephremides (2016).
Ticks lie at ``k * 10**9 // rate_hz + phase``.
"""

from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from tis.common.units import NS_PER_S

Ints = NDArray[np.int64]

MAX_TICKS: Final = 20_000
"""Number of ticks evaluated, evenly spread over the arrivals; more hardly change a mean age."""


class Arrivals(NamedTuple):
    """Arrivals of samples fresher than all before: (N,) instants of arrival and of sampling, both ascending."""

    recv_ns: Ints
    sample_ns: Ints

    @classmethod
    def of(cls, recv_ns: Ints, sample_ns: Ints) -> Self:
        """Return the arrivals, among all (M,), with a fresher sample than any before (oracle: a loop)."""
        # By arrival, and at equal arrivals by sample: the freshest of them comes last and remains.
        order = np.lexsort((sample_ns, recv_ns))
        recv, sample = recv_ns[order], sample_ns[order]
        newest_before = np.concatenate([[np.iinfo(np.int64).min], np.maximum.accumulate(sample)[:-1]])[: len(sample)]
        fresher = sample > newest_before
        return cls(recv[fresher], sample[fresher])


def instant_ns(k: Ints, rate_hz: int) -> Ints:
    """Return the nominal instants of samples ``k`` (N,), as `tis.common.units.sample_instant_ns`."""
    return k * NS_PER_S // rate_hz


def offset_ns(at_ns: Ints, rate_hz: int) -> Ints:
    """Return the time from the last sample instant to each of ``at_ns`` (N,): from 0 to below a period."""
    return at_ns - instant_ns(((at_ns + 1) * rate_hz - 1) // NS_PER_S, rate_hz)


def ages_at_ticks_ns(arrivals: Arrivals, rate_hz: int, phases_ns: Ints) -> Ints:
    """Return the age (P, K) at K ticks of each of P phases: the same K for all, between first and last arrival.

    K is 0 where these are less than two periods apart. Oracle: a loop over ticks and arrivals, in the tests.
    """
    if not len(arrivals.recv_ns):
        return np.empty((len(phases_ns), 0), dtype=np.int64)
    first, last = ((int(arrivals.recv_ns[i]) + 1) * rate_hz // NS_PER_S for i in (0, -1))
    # For every phase these ticks lie between the first and the last arrival.
    k = np.arange(first + 1, last, max(1, (last - first) // MAX_TICKS), dtype=np.int64)
    ticks_ns = instant_ns(k, rate_hz) + phases_ns[:, None]
    newest = np.searchsorted(arrivals.recv_ns, ticks_ns, side="right") - 1
    return np.asarray(ticks_ns - arrivals.sample_ns[newest])


def ages_when_used_ns(arrivals: Arrivals, rate_hz: int, phase_ns: int) -> Ints:
    """Return the age of each sample that is new to a tick of this phase, at that tick, (U,)."""
    due = -(-(arrivals.recv_ns - phase_ns) * rate_hz // NS_PER_S)
    # Instants are rounded down, so the first tick at or after the arrival can be one off.
    due += instant_ns(due, rate_hz) + phase_ns < arrivals.recv_ns
    due -= instant_ns(due - 1, rate_hz) + phase_ns >= arrivals.recv_ns
    # Of the arrivals that one tick finds, only the last is the freshest.
    last_before = np.append(due[1:] != due[:-1], True)[: len(due)]
    return np.asarray(instant_ns(due[last_before], rate_hz) + phase_ns - arrivals.sample_ns[last_before])


class BestPhase(NamedTuple):
    """A phase, the mean age at its ticks and at those of the present phase, and the standard error of the difference.

    The error is that of the paired differences, since the ages belong to the same ticks.
    """

    phase_ns: int
    age_ns: float
    now_age_ns: float
    error_ns: float


def best_phase(streams: list[Arrivals], rate_hz: int, now_ns: int, most_candidates: int = 32) -> BestPhase:
    """Return the phase with the least mean age over all ``streams``, compared with the present one, ``now_ns``.

    Candidates lie 1 % of the period after arrivals, since between arrivals the age only grows. Without ticks to
    compare, the present phase with ages of 0. Oracle: constant delays, a search of all phases, in the tests.
    """
    period_ns = NS_PER_S // rate_hz
    behind = np.concatenate([offset_ns(one.recv_ns, rate_hz) for one in streams]) + period_ns // 100
    candidates = np.unique(behind % period_ns)
    if len(candidates) > most_candidates:
        candidates = candidates[np.linspace(0, len(candidates) - 1, most_candidates).astype(np.int64)]
    candidates = np.concatenate([[now_ns], candidates])

    def ages_ns(phase_ns: int) -> Ints:
        return np.concatenate([ages_at_ticks_ns(one, rate_hz, np.array([phase_ns]))[0] for one in streams])

    now_ages_ns = ages_ns(now_ns)
    if not len(now_ages_ns):
        return BestPhase(now_ns, 0.0, 0.0, 0.0)
    # One candidate after the other, since the ages of all of them would fill tens of MB.
    mean_ns = [float(ages_ns(phase_ns).mean()) for phase_ns in candidates.tolist()]
    best = int(np.argmin(mean_ns))
    error_ns = float((now_ages_ns - ages_ns(int(candidates[best]))).std()) / len(now_ages_ns) ** 0.5
    return BestPhase(int(candidates[best]), mean_ns[best], mean_ns[0], error_ns)


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


def ages_at_ns(recv_ns: Ints, sample_ns: Ints, at_ns: Ints) -> Ints:
    """Return the age of the freshest sample at each instant ``at_ns`` (T,), -1 where none has arrived.

    Arrivals (N,) as in `Arrivals`, both ascending; one at the same instant counts.
    """
    newest = np.searchsorted(recv_ns, at_ns, side="right") - 1  # -1: before the first arrival
    if not len(recv_ns):
        return np.full(len(at_ns), -1, dtype=np.int64)
    return np.where(newest < 0, -1, at_ns - sample_ns[newest])
