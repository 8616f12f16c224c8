"""A synthetic surgeon: minimum-jerk movements with pauses, tremor, slow turning and an arm that follows.

Every quantity is a function of continuous time that the seed decides, sampled at the rows' instants: more
rows show more of the same path, another rate shows it more finely or coarsely. It is no recording of a person;
the constants were fitted so that the tip's speed, acceleration and hold-last error are of the order of recorded
suturing.
"""

from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import ndtri

from common.channels import FOLLOWER, MASTER, Hand
from common.scenario.source import SyntheticSource
from common.sources.minimum_jerk import Movements
from common.sources.trajectory import Array, HandRecording, PoseTrack, Recording
from common.streams import Stream
from common.units import MM_PER_M

Band = tuple[float, float]
Point = tuple[float, float, float]

_GAIN: Final = 0.5  # from master to arm, as in the recordings
_CENTRE_M: Final[dict[Hand, Point]] = {"left": (0.1, -0.05, 0.35), "right": (0.2, 0.05, 0.35)}
_ARM_OFFSET_M: Final[dict[Hand, Point]] = {"left": (0.0, 0.05, -0.15), "right": (-0.1, 0.0, -0.2)}
_RESIDUAL_MM: Final = 0.015  # what a static gain leaves in the recordings, rms per axis
_RESIDUAL_HZ: Final[Band] = (0.2, 8.0)

_LENGTH_SPREAD: Final = 1.1  # standard deviation of the logarithm
_DURATION_SPREAD: Final = 0.5
_ISOCHRONY: Final = 0.3  # the power of length by which longer movements take longer
_P_OVERLAP: Final = 0.2
_LONGEST_OVERLAP: Final = 0.5  # of the duration of the movement that is overlapped
_HALF_SPACE_MM: Final = 50.0

_TREMOR_BAND: Final[Band] = (0.93, 1.07)  # of the centre frequency
_TURN_RAD: Final = 0.25
_TURN_HZ: Final[Band] = (0.03, 0.4)
_OPEN_RAD: Final = 0.8
_HOLD_S: Final = 3.0
_SWITCH_S: Final = 0.5

_FIRST_BATCH: Final = 64
_N_SINES: Final = 10


def synthesise(source: SyntheticSource, seed: int, rate_hz: int, n_rows: int, start: int) -> Recording:
    """Return ``n_rows`` (>= 1) rows at ``rate_hz``, of which row ``start`` becomes sample 0.

    Row i is the path at ``i / rate_hz`` s whatever ``n_rows`` is, and a hand is the same with or without the
    other. The arm is half the master's movement plus an offset and a residual of 15 um rms. Oracles: the path
    at another rate and length, `common.sources.pairing`, and the statistics of recorded suturing.
    """
    t_s = np.arange(n_rows) / rate_hz
    return Recording(
        label=f"synthetic surgeon, seed {seed}",
        rate_hz=rate_hz,
        hands=tuple(_hand(source, seed, hand, t_s) for hand in source.hands),
        start=start,
        pairing=", ".join(
            f"{MASTER[hand]} -> {FOLLOWER[hand]} (synthetic: by construction)" for hand in source.hands
        ),
    )


def _hand(source: SyntheticSource, seed: int, hand: Hand, t_s: Array) -> HandRecording:
    def stream(what: str) -> Stream:
        return Stream.named(seed, f"synthetic/{hand}/{what}")

    until_s = float(t_s[-1])
    low, high = _TREMOR_BAND
    tremor_mm = _wander(stream("tremor"), t_s, (low * source.tremor_hz, high * source.tremor_hz), source.tremor_mm)
    moved_mm = _reaches(source, stream("movements"), until_s).at(t_s) + tremor_mm
    master_m = np.array(_CENTRE_M[hand]) + moved_mm / MM_PER_M
    residual_m = _wander(stream("residual"), t_s, _RESIDUAL_HZ, _RESIDUAL_MM) / MM_PER_M
    arm_m = _GAIN * master_m + np.array(_ARM_OFFSET_M[hand]) + residual_m
    # Ten sines of this size never turn further than half a turn, so the quaternions keep to one hemisphere.
    orientation = Rotation.from_rotvec(_wander(stream("turning"), t_s, _TURN_HZ, _TURN_RAD)).as_quat()
    gripper_rad = _grips(stream("gripper"), until_s).at(t_s)[:, 0]
    return HandRecording(
        hand,
        FOLLOWER[hand],
        command=PoseTrack(master_m, orientation, gripper_rad),
        follower=PoseTrack(arm_m, orientation, gripper_rad),
    )


def _reaches(source: SyntheticSource, stream: Stream, until_s: float) -> Movements:
    """Return the hand's movements in mm about its centre, until after ``until_s``.

    Lengths and durations are lognormal, of median ``reach_mm`` and mean ``movement_s``; directions isotropic.
    """
    spread = np.hypot(_DURATION_SPREAD, _ISOCHRONY * _LENGTH_SPREAD)
    n_movements = _FIRST_BATCH
    while True:
        drawn = stream.uniforms(0, 6 * n_movements).reshape(n_movements, 6)
        log_length = _LENGTH_SPREAD * ndtri(drawn[:, 0])
        log_duration = _DURATION_SPREAD * ndtri(drawn[:, 1]) + _ISOCHRONY * log_length
        duration_s = source.movement_s * np.exp(log_duration - spread**2 / 2)
        overlap_s = _LONGEST_OVERLAP * drawn[:, 3] * duration_s
        pause_s = -source.pause_s * np.log(drawn[:, 3])
        following_s = np.cumsum(duration_s + np.where(drawn[:, 2] < _P_OVERLAP, -overlap_s, pause_s))
        if following_s[-2] > until_s:
            break
        n_movements *= 2
    height, angle = 2.0 * drawn[:, 4] - 1.0, 2.0 * np.pi * drawn[:, 5]
    flat = np.sqrt(1.0 - height**2)
    direction = np.column_stack([flat * np.cos(angle), flat * np.sin(angle), height])
    steps_mm = source.reach_mm * np.exp(log_length)[:, np.newaxis] * direction
    targets_mm = _within(steps_mm, max(_HALF_SPACE_MM, 1.5 * source.reach_mm))
    return Movements(np.concatenate([[0.0], following_s[:-1]]), duration_s, targets_mm)


def _within(steps: Array, half_space: float) -> Array:
    """Return where steps (M, 3) lead (M + 1, 3) from 0; a component that would leave the cube turns back."""
    place = [0.0, 0.0, 0.0]
    places = [tuple(place)]
    for step in steps.tolist():
        for axis, d in enumerate(step):
            there = place[axis] + d
            if abs(there) > half_space:
                there = min(max(place[axis] - d, -half_space), half_space)
            place[axis] = there
        places.append(tuple(place))
    return np.array(places)


def _grips(stream: Stream, until_s: float) -> Movements:
    """Return the gripper's openings and closings in rad, with exponential holds between them."""
    n_grips = _FIRST_BATCH
    while True:
        onset_s = np.cumsum(_SWITCH_S - _HOLD_S * np.log(stream.uniforms(0, n_grips)))
        if onset_s[-1] > until_s:
            break
        n_grips *= 2
    target = np.where(np.arange(n_grips + 1) % 2, _OPEN_RAD, 0.0)
    return Movements(onset_s, np.full(n_grips, _SWITCH_S), target[:, np.newaxis])


def _wander(stream: Stream, t_s: Array, band_hz: Band, std: float) -> Array:
    """Return three independent band-limited noises, shape (N, 3), of standard deviation ``std``.

    Each is a sum of sinusoids of random phase (Rice, "Mathematical analysis of random noise", 1944), hence a
    function of continuous time. Every tenth of the band holds one, of random frequency; in a narrow band they
    beat: a tremor swells and fades.
    """
    low_hz, high_hz = band_hz
    noise = np.zeros((3, len(t_s)))
    for axis, drawn in enumerate(stream.uniforms(0, 6 * _N_SINES).reshape(3, _N_SINES, 2)):
        for k, (place, turns) in enumerate(drawn):
            frequency_hz = low_hz + (k + place) / _N_SINES * (high_hz - low_hz)
            noise[axis] += np.sin(2.0 * np.pi * (frequency_hz * t_s + turns))
    return np.ascontiguousarray(std * np.sqrt(2.0 / _N_SINES) * noise.T)
