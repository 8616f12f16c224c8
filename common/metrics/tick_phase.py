"""Age of the freshest sample at ticks of a given phase, from the arrivals of a stream of samples.

The age is that of Kaul, Yates and Gruteser (2012), here at the ticks ``k * 10**9 // rate_hz + phase``.
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

    K is 0 where these are less than two periods apart. Oracle: a loop over ticks and arrivals, test_tick_phase.
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
    compare, the present phase with ages of 0. Oracle: constant delays, a search of all phases, test_tick_phase.
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
