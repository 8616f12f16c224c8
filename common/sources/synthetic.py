"""A synthetic surgeon: two hands that make minimum-jerk movements, pause, drift and tremble, and arms that follow.

Every quantity is a function of continuous time, determined by the seed and sampled at the rows' instants: more rows
extend the same path, another rate samples it more finely or coarsely. It is no recording of a person; its constants
were fitted to the aggregate statistics of recorded suturing (`common.sources.calibration`).

The rows of JIGSAWS are not evenly spaced in time: in all examined trials each shows the latest sample of a recorder
at 51.33 Hz, so neighbouring rows are one or two of its samples apart, in both arms alike. `recorder_hz` reproduces
this; without it the next position would be much easier to predict than in recordings.
"""

from typing import Final

import numpy as np
import scipy

from common.channels import FOLLOWER, MASTER, Hand
from common.scenario.source import SyntheticSource
from common.sources.clutch import Clutch
from common.sources.minimum_jerk import Movements
from common.sources.reaching import reaching, timing_of
from common.sources.recorder import latest_sample_s
from common.sources.servo import GRID_HZ, servo
from common.sources.trajectory import Array, HandRecording, PoseTrack, Recording
from common.sources.turning import turning, turning_tremor
from common.sources.wander import Band, wander
from common.streams import Stream
from common.units import MM_PER_M

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
    clutch is pressed. Oracles: the path at another rate and length, `common.sources.pairing`, and the statistics of
    recorded suturing.
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
