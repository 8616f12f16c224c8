"""A cycle in a record: its period, and the parts of the period in which delay or loss differ.

The parts are the leaves of a regression tree over the phase, cross-validated (Breiman, Friedman, Olshen, Stone,
"Classification and regression trees", 1984).
"""

from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from tis.common.trace import Trace
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.netem.draws.blocks import Floats
from tis.netem.fit.half_life import gaussian_scores

_MIN_CYCLES: Final = 8
_MIN_PERIOD_S: Final = 1.0
_MAX_BINS: Final = 1_000_000
_MAX_MULTIPLES: Final = 8
_MIN_SCORE: Final = 0.1
_NEARLY: Final = 0.85
_TREND_S: Final = 2.0
_MIN_PART_S: Final = 0.01
_MAX_PARTS: Final = 30
_MIN_GAIN: Final = 20.0
_FEWEST_MEANS: Final = 5
_CERTAIN: Final = 4.0
_NOTICED: Final = 0.2
_NOTICED_LOSS: Final = 0.005


class Cycle(NamedTuple):
    """Parts of a cycle: ``lengths_s`` and ``leaves`` in order, ``leaf`` (N,) that of each message.

    A leaf is a number; parts of the same leaf are alike. ``base`` is the leaf that lasts longest.
    """

    lengths_s: tuple[float, ...]
    leaves: tuple[int, ...]
    leaf: NDArray[np.int64]
    base: int
    n_cycles: int


def fit_cycle(trace: Trace) -> Cycle | None:
    """Return the cycle of a record; None without one that both the odd and the even periods show.

    The period is that of the delays or their Gaussian scores, with or without a slow trend, or of the losses. Oracle:
    known cycles and none, tests/netem/fit/test_cycle.
    """
    sent_s = (trace.sent_ns - trace.sent_ns[0]) / NS_PER_S
    interval_s = float(np.median(np.diff(sent_s)))
    width_s = max(0.05, 2 * interval_s)
    if sent_s[-1] < _MIN_CYCLES * _MIN_PERIOD_S or sent_s[-1] / width_s > _MAX_BINS:
        return None
    channels = _channels(trace, sent_s, width_s)
    found = [(channel, *period_of(channel, width_s)) for channel in channels]
    channel, period_s, score = max(found, key=lambda one: one[2])
    if score < _MIN_SCORE:
        return None
    period_s = _refined(channel, width_s, period_s)
    lost = trace.delay_ns < 0
    part_s = max(_MIN_PART_S, interval_s)
    parts = split_phases(sent_s, np.where(lost, np.nan, trace.delay_ns / NS_PER_MS), period_s, part_s)
    if parts is None:
        return None
    edges, leaves, base = parts
    place = np.searchsorted(edges[1:-1], sent_s % period_s, side="right")
    return Cycle(
        tuple(float(f"{length:.6f}") for length in np.diff(edges)),
        tuple(int(leaf) for leaf in leaves),
        np.asarray(leaves[place]),
        base,
        int(sent_s[-1] / period_s),
    )


def _channels(trace: Trace, sent_s: Floats, width_s: float) -> list[Floats]:
    """Return centred series of equal bins: scores, the same without their trend, delays without it, losses."""
    lost = trace.delay_ns < 0
    number = (sent_s / width_s).astype(np.int64)
    n_bins = int(number[-1]) + 1
    n_sent = np.bincount(number, minlength=n_bins)
    n_arrived = np.bincount(number[~lost], minlength=n_bins)
    sums = np.bincount(number[~lost], gaussian_scores(trace.delay_ns[~lost]), n_bins)
    scores = np.divide(sums, n_arrived, out=np.zeros(n_bins), where=n_arrived > 0)
    trend = scipy.ndimage.median_filter(scores, size=2 * round(_TREND_S / width_s / 2) + 1)
    losses = np.divide(np.bincount(number, lost, n_bins), n_sent, out=np.zeros(n_bins), where=n_sent > 0)
    delays = np.divide(
        np.bincount(number[~lost], trace.delay_ns[~lost].astype(np.float64), n_bins),
        n_arrived,
        out=np.full(n_bins, float(np.median(trace.delay_ns[~lost]))),
        where=n_arrived > 0,
    )
    sharp = delays - scipy.ndimage.median_filter(delays, size=2 * round(_TREND_S / width_s / 2) + 1)
    return [channel - channel.mean() for channel in (scores, scores - trend, sharp, losses)]


def period_of(channel: Floats, width_s: float) -> tuple[float, float]:
    """Return the best period in s and its score, the mean autocorrelation at its multiples."""
    n = len(channel)
    power = np.abs(np.fft.rfft(channel, 2 * n)) ** 2
    similarity = np.fft.irfft(power)[:n] / np.arange(n, 0, -1)
    if not similarity[0] > 0:
        return 0.0, 0.0
    similarity = similarity / similarity[0]
    periods = np.arange(_MIN_PERIOD_S / width_s, n / _MIN_CYCLES, 0.125)
    if not len(periods):
        return 0.0, 0.0
    places = np.rint(periods[:, None] * np.arange(1, _MAX_MULTIPLES)).astype(np.int64)
    scores = similarity[places].mean(axis=1)
    # a multiple of the period scores as well: the first that nearly reaches the best, and its own top
    first = int(np.argmax(scores >= _NEARLY * scores.max()))
    near = slice(first, first + max(2, int(0.1 * periods[first] * 8)))
    best = first + int(np.argmax(scores[near]))
    # the autocorrelation about the period, halfway to its neighbours, is that of a trend and not of a cycle
    half = np.rint(periods[best] * (np.arange(1, _MAX_MULTIPLES) - 0.5)).astype(np.int64)
    return float(periods[best] * width_s), float(scores[best] - max(0.0, float(similarity[half].mean())))


def _refined(channel: Floats, width_s: float, period_s: float) -> float:
    """Return the period near ``period_s`` at which the folded series varies most from phase to phase."""
    at_s = (np.arange(len(channel)) + 0.5) * width_s
    n_cycles = at_s[-1] / period_s
    n_phases = max(8, round(period_s / width_s))

    def varies(period: float) -> float:
        phase = (at_s % period / period * n_phases).astype(np.int64)
        count = np.maximum(np.bincount(phase, minlength=n_phases), 1)
        mean = np.bincount(phase, channel, n_phases) / count
        return float((mean**2 * count).sum())

    reach, step = 1.5 * width_s, width_s / n_cycles / 4
    tried = period_s + np.arange(-reach, reach, step)
    values = np.array([varies(float(period)) for period in tried])
    # the middle of those that are nearly as good
    good = tried[values >= values.max() * 0.995]
    return float(good.mean())


class Parts(NamedTuple):
    """Edges (P + 1,) of P parts in s from the cycle's beginning, the leaf of each (P,), and the base leaf."""

    edges: Floats
    leaves: NDArray[np.int64]
    base: int


class _Profile(NamedTuple):
    """Sums over the messages of each phase: (2, channels, bins), odd and even periods, in units of the noise."""

    sums: Floats
    counts: Floats


def split_phases(sent_s: Floats, delay_ms: Floats, period_s: float, part_s: float) -> Parts | None:
    """Return the parts of a cycle, None if its phases do not differ.

    Parameters
    ----------
    sent_s, delay_ms
        (N,) send times and delays, nan where lost.
    period_s, part_s
        The period, and the least length of a part.

    Notes
    -----
    A part is split where both halves of the record, odd and even periods, predict each other better with the split:
    what one period alone shows is no cycle. Oracle: known cycles, tests/netem/fit/test_cycle.
    """
    n_bins = max(2, int(period_s / part_s))
    phase = np.minimum((sent_s % period_s / period_s * n_bins).astype(np.int64), n_bins - 1)
    odd = (sent_s // period_s).astype(np.int64) % 2
    profile = _profile(phase, odd, delay_ms, n_bins)
    cuts = [0, n_bins]
    gains: dict[tuple[int, int], tuple[float, int]] = {}
    while len(cuts) <= _MAX_PARTS:
        for part in pairwise(cuts):
            if part not in gains:
                gains[part] = _best_split(profile, *part)
        best = max(pairwise(cuts), key=lambda part: gains[part][0])
        gain, at = gains[best]
        if gain < _MIN_GAIN:
            break
        cuts = sorted([*cuts, at])
    if len(cuts) == 2:
        return None
    edges = np.array(cuts) / n_bins * period_s
    base = int(np.argmax(np.diff(cuts)))
    place = np.searchsorted(np.array(cuts[1:-1]), phase, side="right")
    leaves = _leaves(place, (sent_s // period_s).astype(np.int64), delay_ms, base, len(cuts) - 1)
    if not np.any(leaves != base):
        return None
    # neighbours that both belong to the base are one part
    begins = np.concatenate([[True], (leaves[1:] != base) | (leaves[:-1] != base)])
    return Parts(np.append(edges[:-1][begins], period_s), leaves[begins], base)


def _profile(phase: NDArray[np.int64], odd: NDArray[np.int64], delay_ms: Floats, n_bins: int) -> _Profile:
    lost = np.isnan(delay_ms)
    centre, spread = float(np.nanmean(delay_ms)), max(float(np.nanstd(delay_ms)), 1e-9)
    middle = np.nanpercentile(delay_ms, [25, 75])
    spread = max(min(spread, float(middle[1] - middle[0])), spread / 50)
    p_loss = float(lost.mean())
    values = (
        (np.where(lost, 0.0, (delay_ms - centre) / spread), ~lost),
        ((lost - p_loss) / max(np.sqrt(p_loss * (1 - p_loss)), 1e-3), np.ones(len(lost), dtype=np.bool_)),
    )
    sums, counts = np.zeros((2, 2, n_bins)), np.zeros((2, 2, n_bins))
    for half in (0, 1):
        for channel, (value, counted) in enumerate(values):
            which = counted & (odd == half)
            sums[half, channel] = np.bincount(phase[which], value[which], n_bins)
            counts[half, channel] = np.bincount(phase[which], minlength=n_bins)
    return _Profile(sums, counts)


def _best_split(profile: _Profile, first: int, stop: int) -> tuple[float, int]:
    """Return gain and place of the best split of bins ``first`` .. ``stop`` - 1: the predicted squares it saves.

    With sums s and counts n of one half, and means m of the other, a part saves 2 m s - n m * m.
    """
    if stop - first < 2:
        return -np.inf, first
    left_s, left_n = (np.cumsum(values[:, :, first:stop], axis=2) for values in profile)
    all_s, all_n = left_s[:, :, -1:], left_n[:, :, -1:]

    def saved(s: Floats, n: Floats) -> Floats:
        mean = s / np.maximum(n, 1)
        return np.asarray(2 * mean[::-1] * s - n * mean[::-1] ** 2)

    gain = saved(left_s, left_n) + saved(all_s - left_s, all_n - left_n) - saved(all_s, all_n)
    both = np.where((gain > 0).all(axis=0), gain.sum(axis=0), np.minimum(gain.sum(axis=0), 0.0)).sum(axis=0)[:-1]
    at = int(np.argmax(both))
    return float(both[at]), first + at + 1


def _leaves(
    part: NDArray[np.int64], cycle: NDArray[np.int64], delay_ms: Floats, base: int, n_parts: int
) -> NDArray[np.int64]:
    """Return the leaf of each part: its own number, or the base where the periods do not tell it from the base."""
    of_base = delay_ms[part == base]
    spread = max(float(np.nanstd(of_base)), 1e-3)
    lost = np.isnan(delay_ms).astype(np.float64)
    leaves = np.arange(n_parts)
    for number in range(n_parts):
        own = part == number
        arrived = own & (lost == 0)
        later = _by_cycle(cycle[arrived], delay_ms[arrived] - float(np.nanmean(of_base)))
        more_lost = _by_cycle(cycle[own], lost[own] - float(np.isnan(of_base).mean()))
        if not (_stands_out(later, _NOTICED * spread) or _stands_out(more_lost, _NOTICED_LOSS)):
            leaves[number] = base
    return leaves


def _by_cycle(cycle: NDArray[np.int64], values: Floats) -> Floats:
    """Return the mean of ``values`` (n,) in each period that has any."""
    _, which = np.unique(cycle, return_inverse=True)
    return np.asarray(np.bincount(which, values) / np.bincount(which)) if len(values) else np.empty(0)


def _stands_out(values: Floats, noticed: float) -> bool:
    """Tell whether means of periods, (n,), differ from 0 by more than chance and more than ``noticed``."""
    if len(values) < _FEWEST_MEANS:
        return False
    mean, error = float(values.mean()), float(values.std(ddof=1)) / np.sqrt(len(values))
    return bool(abs(mean) > max(noticed, _CERTAIN * error))
