"""Reaching movements of a hand: a random sequence of minimum-jerk movements with pauses and overlaps.

The constants and the defaults of `SyntheticSource` were fitted together, to the aggregate statistics of recorded
suturing that `tis.common.sources.calibration` holds.
"""

from typing import Final, NamedTuple

import numpy as np
import scipy

from tis.common.scenario.source import SyntheticSource
from tis.common.sources.minimum_jerk import Movements
from tis.common.sources.trajectory import Array
from tis.common.streams import Stream

_LENGTH_SPREAD: Final = 1.35  # standard deviation of the logarithm
_DURATION_SPREAD: Final = 0.45
_ISOCHRONY: Final = 0.43  # the power of length by which longer movements take longer
_P_OVERLAP: Final = 0.2
_MAX_OVERLAP: Final = 0.5  # of the duration of the movement that is overlapped
_HALF_SPACE_MM: Final = 40.0

_FIRST_BATCH: Final = 64


class Timing(NamedTuple):
    """Onsets (M,) and durations (M,) of movements in s, and the normal scores (M,) of their lengths' logarithms."""

    onset_s: Array
    duration_s: Array
    length_score: Array


def timing_of(source: SyntheticSource, share: float, timing: Stream, until_s: float) -> Timing:
    """Return the timing of a sequence until after ``until_s``: ``share`` (0 < share <= 1) of a hand's movements.

    Lengths and durations are lognormal, of median ``reach_mm`` and mean ``movement_s``, correlated by isochrony.
    Pauses grow as the share shrinks, so that sequences whose shares add up to 1 have as many movements as one alone.
    Isochrony: Viviani and McCollum, "The relation between linear extent and velocity in drawing movements" (1983).
    """
    spread = np.hypot(_DURATION_SPREAD, _ISOCHRONY * _LENGTH_SPREAD)
    moving_s = source.movement_s * (1.0 - _P_OVERLAP * _MAX_OVERLAP / 2.0)
    pause_s = source.pause_s / share + moving_s * (1.0 / share - 1.0) / (1.0 - _P_OVERLAP)
    # Timing: draws are addressed by index, so that a larger batch repeats the smaller one and appends to it.
    n_movements = _FIRST_BATCH
    while True:
        drawn = timing.uniforms(0, 4 * n_movements).reshape(n_movements, 4)
        length_score = scipy.special.ndtri(drawn[:, 0])
        log_length = _LENGTH_SPREAD * length_score
        log_duration = _DURATION_SPREAD * scipy.special.ndtri(drawn[:, 1]) + _ISOCHRONY * log_length
        duration_s = source.movement_s * np.exp(log_duration - spread**2 / 2.0)
        overlap_s = _MAX_OVERLAP * drawn[:, 3] * duration_s
        paused_s = -pause_s * np.log(drawn[:, 3])
        following_s = np.cumsum(duration_s + np.where(drawn[:, 2] < _P_OVERLAP, -overlap_s, paused_s))
        if following_s[-2] > until_s:
            break
        n_movements *= 2
    return Timing(np.concatenate([[0.0], following_s[:-1]]), duration_s, length_score)


def reaching(source: SyntheticSource, timing: Timing, aim: Stream) -> Movements:
    """Return a sequence of movements in mm; ``aim`` draws their isotropic directions.

    Oracle: the shape of single movements and the statistics of recorded suturing.
    """
    n_movements = len(timing.onset_s)
    aimed = aim.uniforms(0, 3 * n_movements).reshape(n_movements, 3)
    length_mm = source.reach_mm * np.exp(_LENGTH_SPREAD * timing.length_score)
    half_space_mm = max(_HALF_SPACE_MM, 1.5 * source.reach_mm)
    steps_mm = length_mm[:, np.newaxis] * directions(aimed)
    targets_mm = about_the_centre(steps_mm, half_space_mm * aimed[:, 2], half_space_mm)
    return Movements(timing.onset_s, timing.duration_s, targets_mm)


def directions(drawn: Array) -> Array:
    """Return isotropic unit vectors (M, 3) from uniform numbers (M, 2 or more).

    Uniform height and azimuth are uniform on the sphere (Archimedes).
    """
    height, angle = 2.0 * drawn[:, 0] - 1.0, 2.0 * np.pi * drawn[:, 1]
    flat = np.sqrt(1.0 - height**2)
    return np.column_stack([flat * np.cos(angle), flat * np.sin(angle), height])


def about_the_centre(steps: Array, free: Array, half_space: float) -> Array:
    """Return the positions (M + 1, 3) that steps (M, 3) lead to from 0, within a cube and mostly near its centre.

    A component that would lead outwards beyond ``free`` (M,) is reversed.
    """
    place = [0.0, 0.0, 0.0]
    places = [tuple(place)]
    for step, limit in zip(steps.tolist(), free.tolist(), strict=True):
        for axis, d in enumerate(step):
            there = place[axis] + d
            if abs(there) > limit and there * d > 0:
                there = min(max(place[axis] - d, -half_space), half_space)
            place[axis] = there
        places.append(tuple(place))
    return np.array(places)
