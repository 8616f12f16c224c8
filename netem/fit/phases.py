"""Parts of a known cycle in which delay or loss differ: a regression tree over the phase, cross-validated.

Breiman, Friedman, Olshen, Stone, "Classification and regression trees", 1984.
"""

from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.netem.draws.blocks import Floats

_MAX_PARTS: Final = 30
_MIN_GAIN: Final = 20.0
_MIN_CYCLES: Final = 5
_CERTAIN: Final = 4.0
_NOTICED: Final = 0.2
_NOTICED_LOSS: Final = 0.005


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
    what one period alone shows is no cycle. Oracle: known cycles, tests/netem/fit/test_phases.
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
    if len(values) < _MIN_CYCLES:
        return False
    mean, error = float(values.mean()), float(values.std(ddof=1)) / np.sqrt(len(values))
    return bool(abs(mean) > max(noticed, _CERTAIN * error))
