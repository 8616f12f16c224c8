"""A synthetic surgeon: two hands that make minimum-jerk movements, pause, drift and tremble, and arms that follow.

Every quantity is a function of continuous time, determined by the seed and sampled at the rows' instants: more rows
extend the same path, another rate samples it more finely or coarsely. It is no recording of a person; its constants
were fitted to the aggregate statistics of recorded suturing (`tis.common.sources.calibration`).

The rows of JIGSAWS are not evenly spaced in time: in all examined trials each shows the latest sample of a recorder
at 51.33 Hz, so neighbouring rows are one or two of its samples apart, in both arms alike. `recorder_hz` reproduces
this; without it the next position would be much easier to predict than in recordings.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, pi
from typing import Final

import numpy as np
import scipy

from tis.common.channels import FOLLOWER, MASTER, Hand
from tis.common.scenario.live_source import LiveSource
from tis.common.scenario.source import SyntheticSource
from tis.common.sources.hand_movements import Band, Movements, reaching, timing_of, turning, turning_tremor, wander
from tis.common.sources.provenance import digest_of_synthetic
from tis.common.sources.trajectory import Array, HandRecording, PoseTrack, Recording
from tis.common.streams import Stream
from tis.common.units import MM_PER_M

# The clutch of the master console: a pedal that uncouples both arms while the masters are moved back.
#
# The hands come to rest, the pedal is pressed, the masters move, the pedal is released, the work continues. Working
# time stands still meanwhile. The arm is half the master's movement plus a constant, which each clutch action
# changes.

EASE_S: Final = 0.3
"""Time in which the hands come to rest before the pedal is pressed, and resume speed afterwards."""
PRESSED_S: Final = 1.0
"""Time during which the pedal is pressed."""

_STRETCH_S: Final = 2.0 * EASE_S + PRESSED_S
_LOST_S: Final = EASE_S + PRESSED_S  # each of the two easings costs half of its duration
_AWAY_MM: Final = 40.0
_FIRST_CLUTCHES: Final = 16


@dataclass(frozen=True)
class Clutch:
    """Instants (K >= 1,) in s at which the hands begin to come to rest, at least one clutch action apart."""

    onset_s: Array

    @classmethod
    def pressed(cls, per_min: float, stream: Stream, until_s: float) -> "Clutch":
        """Return clutch actions until after ``until_s``, ``per_min`` (0 to 37, exclusive), with exponential gaps."""
        n_stretches = _FIRST_CLUTCHES
        while True:
            gap_s = -(60.0 / per_min - _STRETCH_S) * np.log(stream.uniforms(0, n_stretches))
            onset_s = np.cumsum(gap_s + _STRETCH_S) - _STRETCH_S
            if onset_s[-1] > until_s:
                return cls(onset_s)
            n_stretches *= 2

    def working_s(self, t_s: Array) -> Array:
        """Return the working time (N,) in s at times (N,). Oracle: its rate, integrated."""
        begun = np.searchsorted(self.onset_s, t_s, side="right")
        into_s = t_s - self.onset_s[np.maximum(begun - 1, 0)]
        off = np.clip(into_s / EASE_S, 0.0, 1.0)
        on = np.clip((into_s - EASE_S - PRESSED_S) / EASE_S, 0.0, 1.0)
        lost_s = EASE_S * (_eased(off) + on - _eased(on)) + np.clip(into_s - EASE_S, 0.0, PRESSED_S)
        return np.asarray(np.where(begun > 0, t_s - _LOST_S * (begun - 1) - lost_s, t_s))

    def moved_mm(self, stream: Stream, t_s: Array) -> Array:
        """Return the displacement (N, 3) of a master by its clutch actions, in mm."""
        places = np.zeros((len(self.onset_s) + 1, 3))
        places[1:] = _AWAY_MM * (2.0 * stream.uniforms(0, 3 * len(self.onset_s)).reshape(-1, 3) - 1.0)
        lasting_s = np.full(len(self.onset_s), PRESSED_S)
        return Movements(self.onset_s + EASE_S, lasting_s, places).at(t_s)


def _eased(phase: Array) -> Array:
    """Return the integral of `minimum_jerk` from 0 to ``phase``."""
    return np.asarray(phase**4 * (2.5 + phase * (-3.0 + phase)))


# An arm that follows its command as a second-order servo: ``x'' = w^2 (u - x) - 2 zeta w x'``.

GRID_HZ: Final = 1000
"""Rate at which the command is evaluated; in between it is taken as linear."""


def servo(path: Callable[[Array], Array], t_s: Array, bandwidth_hz: float, damping: float) -> Array:
    """Return the servo's positions (N, d) at ascending times ``t_s`` (N,) for the command ``path(t)``.

    ``path`` gives positions (M, d) at times (M,). The servo rests at ``path(0)`` until t = 0, so its movement is a
    function of continuous time and does not depend on ``t_s``. Exact for a command that is linear between the grid's
    instants. Oracle: the differential equation solved numerically, test_servo.
    """
    w = 2.0 * pi * bandwidth_hz
    grid_s = np.arange(ceil(max(float(t_s[-1]), 0.0) * GRID_HZ) + 2) / GRID_HZ
    command = path(grid_s)
    # First-order hold is exact for a command that is linear between the grid's instants.
    system = np.array([w * w]), np.array([1.0, 2.0 * damping * w, w * w])
    (numerator,), denominator, _ = scipy.signal.cont2discrete(system, 1.0 / GRID_HZ, "foh")
    at_rest = scipy.signal.lfilter_zi(numerator, denominator)[:, None] * command[0]
    followed, _ = scipy.signal.lfilter(numerator, denominator, command, axis=0, zi=at_rest)
    return np.stack([np.interp(t_s, grid_s, axis) for axis in followed.T], axis=1)


def latest_sample_s(t_s: Array, recorder_hz: float, phase: float) -> Array:
    """Return the instants (N,) in s of a recorder's latest samples at or before the instants ``t_s`` (N,), in s.

    The recorder samples at ``(j - phase) / recorder_hz`` for all integers j; ``phase`` is in [0, 1). Where
    ``recorder_hz`` is a multiple of the rows' rate, all rows are late by the same ``phase / recorder_hz``. Oracle:
    literal sample numbers; a search among the recorder's instants.
    """
    return np.asarray((np.floor(t_s * recorder_hz + phase) - phase) / recorder_hz)


Point = tuple[float, float, float]

_GAIN: Final = 0.5  # from master to arm, as in the recordings
_CENTRE_M: Final[dict[Hand, Point]] = {"left": (0.1, -0.05, 0.35), "right": (0.2, 0.05, 0.35)}
_ARM_OFFSET_M: Final[dict[Hand, Point]] = {"left": (0.0, 0.05, -0.15), "right": (-0.1, 0.0, -0.2)}
_RESIDUAL_MM: Final = 0.015  # what a static gain leaves in the recordings, rms per axis
_RESIDUAL_HZ: Final[Band] = (0.2, 8.0)

_TREMOR_BAND: Final[Band] = (0.93, 1.07)  # of the centre frequency
_DRIFT_HZ: Final[Band] = (0.05, 1.0)
_SWITCH_S: Final = 0.5

_FIRST_BATCH: Final = 64
_LATER_S: Final = 2.0 / GRID_HZ  # a servo's grid extends beyond the last row by this


def synthesise(source: SyntheticSource, seed: int, rate_hz: int, n_rows: int, start: int) -> Recording:
    """Return ``n_rows`` (>= 1) rows at ``rate_hz``, of which row ``start`` becomes sample 0.

    Row i shows the path at ``i / rate_hz`` s, or with ``recorder_hz`` at the recorder's latest sample by then; it
    does not depend on ``n_rows``, nor a hand on the other one. The arm is half the master's movement, through a servo
    where the source has a bandwidth, plus an offset and a residual of 15 um rms; the offset changes only while the
    clutch is pressed. Oracles: the path at another rate and length, `tis.common.sources.pairing`, and the statistics
    of recorded suturing.
    """
    t_s = np.arange(n_rows) / rate_hz
    warnings: tuple[str, ...] = ()
    if source.recorder_hz is not None:
        if rate_hz > source.recorder_hz:
            warnings = (
                f"the recorder samples the synthetic movement at {source.recorder_hz:g} Hz, so rows at {rate_hz} Hz "
                "repeat; source.recorder_hz: null gives each its own instant",
            )
        # One phase for all devices: a recorder takes them together.
        t_s = latest_sample_s(t_s, source.recorder_hz, Stream.named(seed, "synthetic/recorder").uniform(0))
    # Clutch: working time stands still during clutch actions.
    clutch, working_s = None, t_s
    if source.clutch_per_min > 0.0:
        clutch = Clutch.pressed(
            source.clutch_per_min, Stream.named(seed, "synthetic/clutch"), float(t_s[-1]) + _LATER_S
        )
        working_s = clutch.working_s(t_s)
    return Recording(
        label=f"synthetic surgeon, seed {seed}",
        rate_hz=rate_hz,
        hands=tuple(_hand(source, seed, hand, clutch, working_s, t_s) for hand in source.hands),
        start=start,
        pairing=", ".join(
            f"{MASTER[hand]} -> {FOLLOWER[hand]} (synthetic: by construction)" for hand in source.hands
        ),
        warnings=warnings,
    )


def _hand(
    source: SyntheticSource, seed: int, hand: Hand, clutch: Clutch | None, working_s: Array, t_s: Array
) -> HandRecording:
    def stream(what: str) -> Stream:
        return Stream.named(seed, f"synthetic/{hand}/{what}")

    until_s = float(t_s[-1])
    low, high = _TREMOR_BAND
    tremor_hz = (low * source.tremor_hz, high * source.tremor_hz)
    # Coupled movements have the same timing in both hands, but each hand has its own directions.
    together = Stream.named(seed, "synthetic/together/timing")
    movements, turns = [], []
    for share, which, draws in (
        (1.0 - source.coupling, "alone", stream("alone/timing")),
        (source.coupling, "together", together),
    ):
        if share > 0.0:
            timing = timing_of(source, share, draws, until_s + _LATER_S)
            movements.append(reaching(source, timing, stream(f"{which}/aim")))
            turns.append(turning(source, timing, stream(f"{which}/turn")))

    def worked(at_s: Array) -> Array:
        moved_mm = wander(stream("drift"), at_s, _DRIFT_HZ, source.drift_mm)
        moved_mm += wander(stream("tremor"), at_s, tremor_hz, source.tremor_mm)
        for each in movements:
            moved_mm += each.at(at_s)
        return np.asarray(np.array(_CENTRE_M[hand]) + moved_mm / MM_PER_M)

    worked_m = followed_m = worked(working_s)
    if source.arm_bandwidth_hz is not None:

        def commanded(at_s: Array) -> Array:
            return worked(clutch.working_s(at_s) if clutch else at_s)

        followed_m = servo(commanded, t_s, source.arm_bandwidth_hz, source.arm_damping)
    # The arm follows the working movement; the clutch displaces the master only.
    residual_m = wander(stream("residual"), t_s, _RESIDUAL_HZ, _RESIDUAL_MM) / MM_PER_M
    arm_m = _GAIN * followed_m + np.array(_ARM_OFFSET_M[hand]) + residual_m
    master_m = worked_m + clutch.moved_mm(stream("clutch"), t_s) / MM_PER_M if clutch else worked_m
    turned_rad = turning_tremor(source, stream("turning"), working_s)
    for turn in turns:
        turned_rad += turn.at(working_s)
    # A continuous function of the rotation vector, so the quaternions of a smooth path stay in one hemisphere.
    orientation = scipy.spatial.transform.Rotation.from_rotvec(turned_rad).as_quat()
    gripper_rad = _grips(source, stream("gripper"), until_s).at(working_s)[:, 0]
    return HandRecording(
        hand,
        FOLLOWER[hand],
        command=PoseTrack(master_m, orientation, gripper_rad),
        follower=PoseTrack(arm_m, orientation, gripper_rad),
    )


def _grips(source: SyntheticSource, stream: Stream, until_s: float) -> Movements:
    """Return the openings and closings of the gripper in rad, with exponential holds between them."""
    n_grips = _FIRST_BATCH
    while True:
        onset_s = np.cumsum(_SWITCH_S - source.gripper_hold_s * np.log(stream.uniforms(0, n_grips)))
        if onset_s[-1] > until_s:
            break
        n_grips *= 2
    target = np.where(np.arange(n_grips + 1) % 2, source.gripper_open_rad, 0.0)
    return Movements(onset_s, np.full(n_grips, _SWITCH_S), target[:, np.newaxis])


# A live operator's movement before it is made: its hands, and the synthetic hand that models are trained on.

_USUAL: Final = LiveSource(kind="live")
"""Places and scale of the synthetic hand, from which those of a source are counted."""


def unmade_movement(source: LiveSource, rate_hz: int) -> Recording:
    """Return the hands of a live source and the arms that they drive, without any row: nothing is known yet."""
    nothing = PoseTrack(np.empty((0, 3)), np.empty((0, 4)), np.empty(0))
    hands = tuple(HandRecording(hand, FOLLOWER[hand], nothing, nothing) for hand in source.hands)
    pairing = ", ".join(f"{MASTER[hand]} -> {FOLLOWER[hand]} (live: by convention)" for hand in source.hands)
    return Recording("live device", rate_hz, hands, start=0, pairing=pairing)


def synthetic_training(source: LiveSource, seed: int, rate_hz: int, n_rows: int) -> Recording:
    """Return ``n_rows`` rows of the synthetic hand, in the places and at the scale of a live source.

    Its speeds are those of recorded suturing. The arm is at ``scale`` times the master's movement. Oracle: least
    squares of the arm on the master, tests/common/sources/test_live.
    """
    hand_of = SyntheticSource(kind="synthetic", hands=source.hands)
    made = synthesise(hand_of, seed, rate_hz, n_rows, 0)
    digest = digest_of_synthetic(hand_of, seed, rate_hz)
    hands = tuple(_placed(source, each) for each in made.hands)
    label = f"synthetic hand, seed {seed}"
    return Recording(label, rate_hz, hands, start=0, pairing=made.pairing, digest=digest)


def _placed(source: LiveSource, made: HandRecording) -> HandRecording:
    hand: Hand = made.hand
    moved_m = np.array(source.master_at_mm.of_m(hand)) - np.array(_USUAL.master_at_mm.of_m(hand))
    arm_at_m, usual_arm_m = np.array(source.arm_at_mm.of_m(hand)), np.array(_USUAL.arm_at_mm.of_m(hand))
    arm_m = arm_at_m + source.scale / _USUAL.scale * (made.follower.position_m - usual_arm_m)
    return HandRecording(
        hand,
        made.arm,
        command=PoseTrack(made.command.position_m + moved_m, made.command.orientation, made.command.gripper_rad),
        follower=PoseTrack(arm_m, made.follower.orientation, made.follower.gripper_rad),
    )
