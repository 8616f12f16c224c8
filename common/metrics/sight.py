"""Measures of sight: freezes of a picture, the time from hand to eye, and touch beside sight.

Instants are in ns of run time. A *picture* is a frame that a screen has shown; its age is told by what the picture
itself says, never by the headers of the messages that brought it.
"""

from collections.abc import Mapping
from math import inf, log10
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.units import NS_PER_MS, NS_PER_S

Instants = NDArray[np.int64]

_WINDOW: Final = 30
_FACTOR: Final = 3
_MARGIN_NS: Final = 150 * NS_PER_MS


class Freezes(NamedTuple):
    """Freezes of a picture, each by its begin, the last picture shown before it, and its length; (F,) in ns."""

    begin_ns: Instants
    lasted_ns: Instants
    watched_ns: int
    """From the first picture to the end of watching."""

    @property
    def share_pct(self) -> float | None:
        """Return the share of time in freezes, in %; None without time."""
        return 100.0 * float(self.lasted_ns.sum()) / self.watched_ns if self.watched_ns > 0 else None


def freezes(shown_ns: Instants, until_ns: int) -> Freezes:
    """Return the freezes between pictures shown at ``shown_ns`` (N,), ascending, until ``until_ns``.

    As W3C's webrtc-stats has it: an interval of at least max(3 avg, avg + 150 ms), where avg is the mean of the last
    30 intervals before it, or of as many as there are. Two additions: the time from the last picture to the end
    counts as an interval, since a picture that never comes back is a freeze; and an interval without any before it is
    none. Oracle: the definition interval by interval in fractions, test_sight.
    """
    ends_ns = np.append(shown_ns, max(until_ns, int(shown_ns[-1]))) if len(shown_ns) else shown_ns
    length_ns = np.diff(ends_ns)
    total_ns = np.concatenate([[0], np.cumsum(length_ns)])
    at = np.arange(1, len(length_ns))  # the first interval has no mean
    n = np.minimum(at, _WINDOW)
    sum_ns = total_ns[at] - total_ns[at - n]
    # times n, in integers
    frozen = at[length_ns[at] * n >= np.maximum(_FACTOR * sum_ns, sum_ns + n * _MARGIN_NS)]
    watched_ns = int(ends_ns[-1] - ends_ns[0]) if len(ends_ns) else 0
    return Freezes(ends_ns[frozen], length_ns[frozen], watched_ns)


def hand_to_eye_ns(
    drawn: Instants, command: Instants, shown_ns: Instants, sample_ns: Mapping[int, int], until_ns: int
) -> Instants:
    """Return the time from the sample of each command to the first picture that shows its effect; (C,), by command.

    Parameters
    ----------
    drawn
        Numbers (D,) of the newest command in each frame that was made, -1 for none: the commands that count, whether
        their frames came or not.
    command, shown_ns
        The number of the newest command in each picture (N,), as its stamp tells, and when it was shown.
    sample_ns
        The sample instants by number; numbers of commands that were never sent count for nothing.
    until_ns
        End of watching. What was not seen until then counts with its age there, if that is longer than all that was
        seen: else it may still have been under way.

    Notes
    -----
    The effect of a command is seen with the first picture that shows it or a later one. Of those whose own frame was
    lost or damaged, so that only a later one shows them, none is left out: else a loss would shorten the times. All
    instants are the surgeon's, so that no clock is compared. Oracle: a loop over the commands, test_sight.
    """
    known = np.array(sorted({number for number in drawn.tolist() if number in sample_ns}), dtype=np.int64)
    sent_ns = np.array([sample_ns[number] for number in known.tolist()], dtype=np.int64)
    seen_ns = _first_after(known, command, shown_ns)
    took_ns = (seen_ns - sent_ns)[seen_ns >= 0]
    if not len(took_ns):
        return took_ns
    waited_ns = np.where(seen_ns >= 0, -1, until_ns - sent_ns)
    counts = (seen_ns >= 0) | (waited_ns > took_ns.max())
    return np.asarray(np.where(seen_ns >= 0, seen_ns - sent_ns, waited_ns)[counts])


def onsets(t_ns: Instants, touches: NDArray[np.bool_], apart_ns: int = NS_PER_S // 10) -> Instants:
    """Return the instants at which contacts begin: (M,) of (N,), with no contact in the ``apart_ns`` before them.

    A record that begins in contact has no onset there. Oracle: literal records, test_sight.
    """
    begins = np.flatnonzero(touches[1:] & ~touches[:-1]) + 1
    last = np.maximum.accumulate(np.where(touches, np.arange(len(t_ns)), -1))[begins - 1]
    free = (last < 0) | (t_ns[begins] - t_ns[np.maximum(last, 0)] > apart_ns)
    return np.asarray(t_ns[begins[free]])


def asynchrony_ns(
    onset_ns: Instants, sampled_ns: Instants, felt_ns: Instants, captured_ns: Instants, shown_ns: Instants
) -> Instants:
    """Return how much later than its sight each contact was felt; (M,) of those both felt and seen.

    ``onset_ns`` are the contacts on the patient's clock. A contact is felt with the first of the forces that was
    ``sampled_ns`` at or after it, at ``felt_ns``, and seen with the first picture that was ``captured_ns`` at or
    after it, at ``shown_ns``; what comes earliest counts. Felt and shown are on the surgeon's clock, sampled and
    captured on the patient's, so that no clocks are compared. Oracle: loops, test_sight.
    """
    felt = _first_after(onset_ns, sampled_ns, felt_ns)
    seen = _first_after(onset_ns, captured_ns, shown_ns)
    known = (felt >= 0) & (seen >= 0)
    return felt[known] - seen[known]


def _first_after(onset_ns: Instants, made_ns: Instants, came_ns: Instants) -> Instants:
    """Return when the first of what was made at or after each onset came; -1: never."""
    order = np.argsort(made_ns, kind="stable")
    earliest = np.minimum.accumulate(came_ns[order][::-1])[::-1]
    return np.append(earliest, -1)[np.searchsorted(made_ns[order], onset_ns)]


def behind_others(
    offered_ns: Instants, left_ns: Instants, others_offered_ns: Instants, others_left_ns: Instants
) -> NDArray[np.bool_]:
    """Return which packets (N,) waited for one of the ``others``: offered before, left meanwhile.

    The others are of one key, so they leave in the order in which they were offered. Oracle: every pair, test_sight.
    """
    order = np.argsort(others_offered_ns, kind="stable")
    leaving = np.maximum.accumulate(others_left_ns[order])
    n_before = np.searchsorted(others_offered_ns[order], offered_ns, side="right")
    first = np.searchsorted(leaving, offered_ns, side="right")  # the first one that was still there
    leaves_ns = np.append(leaving, np.iinfo(np.int64).max)[first]
    return np.asarray((first < n_before) & (leaves_ns <= left_ns))


# Quality of a picture against its original: PSNR, and the structural similarity (SSIM).
#
# SSIM after Wang, Bovik, Sheikh and Simoncelli, "Image quality assessment: from error visibility to structural
# similarity" (2004), with equal weights in windows of 8 x 8 pixels, one every 4 pixels, as x264 and the filter of
# FFmpeg take it; their sums are sums of blocks of 4 x 4, so it is fast. On brightness alone.

Picture = NDArray[np.uint8]
"""Red, green and blue, (height, width, 3)."""
Plane = NDArray[np.int32]

_WHITE: Final = 255.0
_BLOCK: Final = 4
_PIXELS: Final = 64
_C1: Final = (0.01 * _WHITE) ** 2
_C2: Final = (0.03 * _WHITE) ** 2
_LUMA: Final = (77, 150, 29)
"""BT.601's weights of red, green and blue, in 256ths; in integers every sum is exact."""


def psnr_db(seen: Picture, original: Picture) -> float:
    """Return the peak signal-to-noise ratio over all pixels and colours, in dB; infinite for equal pictures.

    Raises `ValueError` for pictures of different size. Oracle: pixel by pixel, test_picture_quality.
    """
    _alike(seen, original)
    off = seen.astype(np.int16) - original
    mean = int(np.square(off, dtype=np.int32).sum(dtype=np.int64)) / off.size
    return 10.0 * log10(_WHITE**2 / mean) if mean > 0.0 else inf


def ssim(seen: Picture, original: Picture) -> float:
    """Return the mean structural similarity of the brightness (BT.601), 1 for equal pictures.

    Rows and columns beyond a multiple of 4 are left out; raises `ValueError` for pictures of different size or below
    8 x 8. Oracle: window by window, test_picture_quality.
    """
    _alike(seen, original)
    if min(seen.shape[:2]) < 2 * _BLOCK:
        raise ValueError(f"a picture must have 8 x 8 pixels at least (got {seen.shape[1]} x {seen.shape[0]})")
    x, y = _luma(seen), _luma(original)
    mean_x, mean_y = (_windows(one) / _PIXELS for one in (x, y))
    # variances and the covariance about the windows' means, divided by n - 1 as there
    var_x, var_y, cov = (
        (_windows(one * other) - _PIXELS * mean * mean_of_other) / (_PIXELS - 1)
        for one, other, mean, mean_of_other in (
            (x, x, mean_x, mean_x),
            (y, y, mean_y, mean_y),
            (x, y, mean_x, mean_y),
        )
    )
    alike = (2.0 * mean_x * mean_y + _C1) * (2.0 * cov + _C2)
    return float(np.mean(alike / ((mean_x**2 + mean_y**2 + _C1) * (var_x + var_y + _C2))))


def _luma(picture: Picture) -> Plane:
    red, green, blue = (weight * picture[..., i].astype(np.int32) for i, weight in enumerate(_LUMA))
    return np.asarray((red + green + blue + 128) >> 8)


def _windows(plane: Plane) -> Plane:
    """Return the sums of the windows of 8 x 8 at every fourth pixel."""
    n_rows, n_columns = (n // _BLOCK for n in plane.shape)
    cut = plane[: n_rows * _BLOCK, : n_columns * _BLOCK]
    # twice one axis is much faster than both at once
    rows = cut.reshape(n_rows, _BLOCK, -1).sum(axis=1, dtype=np.int32)
    blocks = sum(rows[:, at::_BLOCK] for at in range(_BLOCK))
    pairs = blocks[:-1] + blocks[1:]
    return np.asarray(pairs[:, :-1] + pairs[:, 1:])


def _alike(seen: Picture, original: Picture) -> None:
    if seen.shape != original.shape or seen.ndim != 3:
        raise ValueError(f"pictures must have the same size (got {seen.shape} and {original.shape})")
