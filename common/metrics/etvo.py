"""Effective time and value offset (ETVO): delay of a reproduced movement, and its remaining error.

After Kroep, Gokhale, Verburg and Venkatesha Prasad, "ETVO: Effectively Measuring Tactile Internet with Experimental
Validation" (arXiv 2107.05343), and "Setting the Yardstick" (INFOCOM 2020, arXiv 2001.01770), which summarises it as
effective delay derivative and effective RMSE. Dynamic programming aligns each reproduced sample with an instant of
the original; the remaining distance is the value offset. Plain dynamic time warping would explain noise by jumps in
time, so changes of the offset are penalised. The penalty differs from the papers': a change costs its length times
the original's rms speed, offsets lie on a fixed grid, and the original is interpolated linearly. Figures are
therefore comparable within this testbed only.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_MAX_OFFSETS: Final = 256


class Etvo(NamedTuple):
    """Offsets of each reproduced sample: ``time_s`` (T,), positive when late; ``value`` (T,), a distance.

    ``delay_derivative`` is the mean absolute rate of change of the time offset, in s per s; None below two samples.
    Time offsets are multiples of ``step_s``.
    """

    time_s: Array
    value: Array
    delay_derivative: float | None
    step_s: float


def offset_grid_s(earliest_s: float, latest_s: float, step_s: float) -> Array:
    """Return the candidate offsets: multiples of ``step_s`` that span both ends, at most 256, including 0."""
    step_s = max(step_s, (latest_s - earliest_s) / (_MAX_OFFSETS - 2))
    return step_s * np.arange(np.floor(earliest_s / step_s + 1e-9), np.ceil(latest_s / step_s - 1e-9) + 1)


def finer_grid_s(offsets_s: Array, found_s: Array) -> Array:
    """Return candidates about the found offsets, a whole number of them a step of the grid that these were found on.

    They span what was found and a step beyond, are at most 256, and hold the former candidates there.
    """
    step_s = offsets_s[1] - offsets_s[0]
    first, last = round(found_s.min() / step_s) - 1, round(found_s.max() / step_s) + 1
    parts = max(1, (_MAX_OFFSETS - 1) // (last - first))
    return np.asarray(step_s / parts * np.arange(first * parts, last * parts + 1))


def etvo(t_s: Array, reproduced: Array, original: Array, offsets_s: Array, every: int = 1) -> Etvo:
    """Align ``reproduced`` (T, D) with ``original`` (T, D), both at ``t_s`` (T,) ascending, by an offset per sample.

    Of a long record only ``every`` so many samples are aligned, with all of the original. The offsets minimise the
    sum of all distances and of ``v |change of offset|``, v the original's rms speed; among equal ones the nearest to
    0 is taken. Beyond its ends the original is constant. Oracles: the best of all paths of a short record, and a
    delayed copy, which has no value offset, test_etvo.
    """
    at_s, samples = t_s[::every], reproduced[::every]
    n, step_s = len(at_s), float(np.diff(offsets_s[:2]).sum())
    if n == 0:
        return Etvo(np.empty(0), np.empty(0), None, step_s)
    speed = _rms_speed(t_s, original)
    axes = np.ascontiguousarray(original.T)  # `np.interp` copies all of an axis that is strided, for each sample
    step = np.diff(offsets_s, prepend=offsets_s[:1]) * speed
    along = np.cumsum(step)
    tie = 1e-12 * speed * np.abs(offsets_s)  # too small to decide anything but ties
    # Forward pass: least cost of each offset at each sample, and the offset before it.
    back = np.empty((n, len(offsets_s)), dtype=np.int16)
    cost = _distances(at_s[0], samples[0], t_s, axes, offsets_s) + tie
    for i in range(1, n):
        cheapest, back[i] = _moved(cost, along)
        cost = cheapest + _distances(at_s[i], samples[i], t_s, axes, offsets_s) + tie
    # Backward pass: the cheapest last offset, and its predecessors.
    path = np.empty(n, dtype=np.int64)
    path[-1] = int(np.argmin(cost))
    for i in range(n - 1, 0, -1):
        path[i - 1] = back[i, path[i]]
    time_s = offsets_s[path]
    then = np.column_stack([np.interp(at_s - time_s, t_s, axis) for axis in axes])
    changed = float(np.abs(np.diff(time_s)).sum() / (at_s[-1] - at_s[0])) if n > 1 else None
    return Etvo(time_s, np.linalg.norm(samples - then, axis=1), changed, step_s)


def _rms_speed(t_s: Array, original: Array) -> float:
    if len(t_s) < 2:
        return 0.0
    return float(np.sqrt(np.mean(np.sum(np.diff(original, axis=0) ** 2, axis=1) / np.diff(t_s) ** 2)))


def _distances(at_s: float, sample: Array, t_s: Array, axes: Array, offsets_s: Array) -> Array:
    then_s = at_s - offsets_s
    squares = np.zeros(len(offsets_s))
    for axis, value in zip(axes, sample, strict=True):
        squares += (np.interp(then_s, t_s, axis) - value) ** 2
    return np.asarray(np.sqrt(squares))


def _moved(cost: Array, along: Array) -> tuple[Array, NDArray[np.int64]]:
    """Return the least cost of reaching each offset, and its predecessor; ``along`` (M,) is the cost from the first.

    Two passes, up and down, as in a distance transform: the cost of a change is proportional to its length.
    """
    # From below: min over j <= i of cost_j + along_i - along_j, a running minimum of cost - along; from above alike.
    up, down = cost - along, cost + along
    lowest_up = np.minimum.accumulate(up)
    lowest_down = np.minimum.accumulate(down[::-1])[::-1]
    from_below = np.maximum.accumulate(np.where(up == lowest_up, np.arange(len(cost)), 0))
    from_above = np.minimum.accumulate(np.where(down == lowest_down, np.arange(len(cost)), len(cost) - 1)[::-1])[::-1]
    below, above = lowest_up + along, lowest_down - along
    return np.minimum(below, above), np.where(below <= above, from_below, from_above)
