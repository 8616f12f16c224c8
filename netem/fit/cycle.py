"""A cycle in a record: its period, and the parts of the period in which delay or loss differ."""

from typing import Final, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from tis.common.trace import Trace
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.netem.draws.blocks import Floats
from tis.netem.fit.half_life import gaussian_scores
from tis.netem.fit.phases import split_phases

_MIN_CYCLES: Final = 8
_MIN_PERIOD_S: Final = 1.0
_MAX_BINS: Final = 1_000_000
_MAX_MULTIPLES: Final = 8
_MIN_SCORE: Final = 0.1
_NEARLY: Final = 0.85
_TREND_S: Final = 2.0
_MIN_PART_S: Final = 0.01


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
    found = [(channel, *_period(channel, width_s)) for channel in channels]
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


def _period(channel: Floats, width_s: float) -> tuple[float, float]:
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
