"""Parts of a synthetic hand's movement: reaches and turns of minimum jerk, with pauses and overlaps, and noise.

The constants and the defaults of `SyntheticSource` were fitted together, to the aggregate statistics of recorded
suturing that `tis.common.sources.calibration` holds.

Point-to-point movements have minimum jerk: Flash and Hogan, "The coordination of arm movements", J. Neuroscience 5
(1985); overlapping movements add up (Flash and Henis, "Arm trajectory modifications during reaching", 1991).
"""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import scipy

from tis.common.scenario.source import SyntheticSource
from tis.common.sources.trajectory import Array
from tis.common.streams import Stream


def minimum_jerk(phase: Array) -> Array:
    """Return the share of a movement done at ``phase`` p of its duration: 10 p^3 - 15 p^4 + 6 p^5, 0 <= p <= 1.

    Oracle: the tests solve the boundary-value problem (sixth derivative zero, rest at both ends).
    """
    p = np.clip(phase, 0.0, 1.0)
    return np.asarray(p**3 * (10.0 + p * (-15.0 + 6.0 * p)))


@dataclass(frozen=True)
class Movements:
    """M movements in D dimensions, in the order of their onsets.

    ``onset_s`` and ``duration_s`` are (M,); ``target`` (M + 1, D) is the resting position before the first movement
    and after each.
    """

    onset_s: Array
    duration_s: Array
    target: Array

    def at(self, t_s: Array) -> Array:
        """Return the positions (N, D) at times (N,). Oracle: the plain sum over all movements."""
        last = np.searchsorted(self.onset_s, t_s, side="right") - 1
        position = self.target[last + 1]
        # First every movement that has begun is taken as complete, then its remaining part is subtracted. Only as
        # many movements back as ever overlap can be incomplete.
        begun = np.searchsorted(self.onset_s, self.onset_s + self.duration_s)
        for lag in range(int(np.max(begun - np.arange(len(begun))))):
            i = np.maximum(last - lag, 0)
            to_come = 1.0 - minimum_jerk((t_s - self.onset_s[i]) / self.duration_s[i])
            to_come[last < lag] = 0.0
            position = position - to_come[:, np.newaxis] * (self.target[i + 1] - self.target[i])
        return position


Band = tuple[float, float]
"""Lowest and highest frequency, in Hz."""

_N_SINES: Final = 10


def wander(stream: Stream, t_s: Array, band_hz: Band, std: float) -> Array:
    """Return three independent noises of standard deviation ``std`` at times (N,), shape (N, 3).

    Each is a sum of sinusoids of random phase (Rice, "Mathematical analysis of random noise", 1944), one of random
    frequency in each tenth of the band; in a narrow band they beat, as a tremor swells and fades. Oracle: size and
    spectrum of the tremor in the tests.
    """
    # A sine of amplitude 1 has variance 1/2, so n of them need the factor sqrt(2 / n).
    low_hz, high_hz = band_hz
    noise = np.zeros((3, len(t_s)))
    for axis, drawn in enumerate(stream.uniforms(0, 6 * _N_SINES).reshape(3, _N_SINES, 2)):
        for k, (place, turns) in enumerate(drawn):
            frequency_hz = low_hz + (k + place) / _N_SINES * (high_hz - low_hz)
            noise[axis] += np.sin(2.0 * np.pi * (frequency_hz * t_s + turns))
    return np.ascontiguousarray(std * np.sqrt(2.0 / _N_SINES) * noise.T)


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


# Each reach also turns the hand, about a random axis, by an angle that grows with the reach's length.
USUAL_TURN_DEG: Final = 19.0
_ANGLE_SPREAD: Final = 1.1  # standard deviation of the logarithm
_ANGLE_WITH_LENGTH: Final = 0.9  # correlation of the logarithms of angle and length
_TURN_SHARE: Final = 0.9  # of the reach's; the turn is in its middle
_HALF_SPACE_RAD: Final = 0.7
_TURN_TREMOR_RAD: Final = 0.0011  # per axis, where movements turn by the usual angle
_TURN_TREMOR_HZ: Final[Band] = (3.5, 12.0)


def turning(source: SyntheticSource, timing: Timing, draws: Stream) -> Movements:
    """Return rotation vectors in rad: a turn for each reach of ``timing``, of median angle ``turn_deg``.

    Angles are lognormal, axes isotropic. The hand stays near its middle orientation, as it stays near the centre of
    its place. Oracle: the statistics of recorded suturing.
    """
    n_movements = len(timing.onset_s)
    drawn = draws.uniforms(0, 4 * n_movements).reshape(n_movements, 4)
    own = np.sqrt(1.0 - _ANGLE_WITH_LENGTH**2) * scipy.special.ndtri(drawn[:, 3])
    median_rad = np.radians(source.turn_deg)
    angle_rad = median_rad * np.exp(_ANGLE_SPREAD * (_ANGLE_WITH_LENGTH * timing.length_score + own))
    half_space_rad = max(_HALF_SPACE_RAD, 1.5 * median_rad)
    steps_rad = angle_rad[:, np.newaxis] * directions(drawn)
    targets_rad = about_the_centre(steps_rad, half_space_rad * drawn[:, 2], half_space_rad)
    onset_s = timing.onset_s + 0.5 * (1.0 - _TURN_SHARE) * timing.duration_s
    return Movements(onset_s, _TURN_SHARE * timing.duration_s, targets_rad)


def turning_tremor(source: SyntheticSource, stream: Stream, t_s: Array) -> Array:
    """Return the trembling of the orientation at times (N,) as rotation vectors (N, 3) in rad."""
    return wander(stream, t_s, _TURN_TREMOR_HZ, _TURN_TREMOR_RAD * source.turn_deg / USUAL_TURN_DEG)
