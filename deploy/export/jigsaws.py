"""A run as two JIGSAWS trials: ``R001`` as the surgeon sent it, ``R002`` as the patient estimated it.

The layout is the data set's, so both can be played. ``R001`` has masters and arms as sent. ``R002`` has the same
masters, and each arm as estimated (``estimated_cp``) at the tick of that sample.

The data set has more than a run: here velocities are differences of neighbouring rows, an absent hand rests at the
origin, and a row without a sample or estimate repeats the previous one, at the begin the first one.
"""

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

import numpy as np
from msgspec import DecodeError

from tis.common.channels import FOLLOWER, Channel, Hand, Side
from tis.common.errors import DataError, Fault, InputError
from tis.common.messages import Pose, decode, position_m
from tis.common.runtime.chunk_writer import by_channel
from tis.common.scenario import Scenario
from tis.common.sources.jigsaws import MIN_ROWS, RATE_HZ, trial_text
from tis.common.sources.trajectory import HandRecording, PoseTrack, Recording
from tis.common.units import NS_PER_S
from tis.deploy.logs.blocks import MAX_NUMBER, Block
from tis.deploy.logs.log_file import LogFile, truncated_start
from tis.deploy.logs.log_paths import log_files
from tis.deploy.logs.payloads import other_version
from tis.deploy.logs.viewer.drawn import RunTopics

SENT: Final = "R001"
ESTIMATED: Final = "R002"
_HANDS: Final[tuple[Hand, ...]] = ("left", "right")

Poses = Mapping[int, tuple[float, ...]]
"""Poses by sample: x, y, z in m, quaternion x, y, z, w, gripper in rad."""


def jigsaws_files(run_dir: Path, scenario: Scenario, topics: RunTopics) -> Iterator[tuple[Path, str]]:
    """Yield the trials' paths in the data set's layout, and their text.

    Raises `InputError` for a run at another rate than the data set's, `DataError` when nothing was sent. Oracle: the
    trials read back and compared with the messages sent (tests/deploy/export/test_export).
    """
    if scenario.rate_hz != RATE_HZ:
        raise InputError(Fault("tis export", "--jigsaws", f"needs a run at {RATE_HZ} Hz", scenario.rate_hz))
    n_rows = scenario.n_samples
    sent = _poses(run_dir, "surgeon", topics, ("command", "arm"))
    if n_rows < MIN_ROWS or not any(sent.values()):
        raise DataError(Fault(str(run_dir), "", "holds no movement that the surgeon sent"))
    estimated = _poses(run_dir, "patient", topics, ("estimated",))
    task = scenario.source.task if scenario.source.kind == "jigsaws" else "Suturing"
    for trial, arm_poses in ((SENT, sent), (ESTIMATED, estimated)):
        hands = []
        for hand in _HANDS:
            row = next((row for row in topics.channels if row.hand == hand), None)
            command = {} if row is None else sent[row.command.key(topics.session)]
            channel = None if row is None else row.arm if trial == SENT else row.estimated
            arm = {} if channel is None else arm_poses[channel.key(topics.session)]
            device = _other_arm(topics, hand) if row is None else row.arm.device
            hands.append(HandRecording(hand, device, _track(command, n_rows), _track(arm, n_rows)))  # type: ignore[arg-type]
        text = trial_text(Recording(trial, RATE_HZ, tuple(hands), 0, ""))
        yield Path(task, "kinematics", "AllGestures", f"{task}_{trial}.txt"), text


def _other_arm(topics: RunTopics, hand: Hand) -> str:
    """Return the arm of an absent hand: one that no other hand drives."""
    taken = {row.arm.device for row in topics.channels}
    return next((arm for arm in (FOLLOWER[hand], *FOLLOWER.values()) if arm not in taken), FOLLOWER[hand])


def _poses(
    run_dir: Path, side: Side, topics: RunTopics, names: tuple[str, ...]
) -> dict[str, dict[int, tuple[float, ...]]]:
    """Return the poses that a side sent on the named channels, by key and sample number."""
    channels: list[Channel[Pose]] = [getattr(row, name) for row in topics.channels for name in names]
    models = {channel.key(topics.session): channel.payload for channel in channels}
    found: dict[str, dict[int, tuple[float, ...]]] = {key: {} for key in models}
    for log, block in _blocks(run_dir, side):
        for channel_id, which in by_channel(block.channel):
            key = log.topic(channel_id)
            for payload in block.payloads(which) if key in found else ():
                pose = _pose(models[key], payload, key)
                # the sample's instant or that of its tick: up to 1/4 period early, 3/4 late
                number = round(pose.sample_ns * topics.rate_hz / NS_PER_S - 0.25)
                turn = pose.orientation
                found[key].setdefault(number, (*position_m(pose), turn.x, turn.y, turn.z, turn.w, pose.gripper_rad))
    return found


def _blocks(run_dir: Path, side: Side) -> Iterator[tuple[LogFile, Block]]:
    """Yield the messages of a side's log, part by part."""
    for path in log_files(run_dir).get(side, ()):
        if path.is_file() and not truncated_start(path):
            log = LogFile(path)
            yield from ((log, block) for block in log.blocks())


def _pose(model: type[Pose], payload: bytes, key: str) -> Pose:
    try:
        pose = decode(payload, model)
    except DecodeError:
        raise other_version(key) from None
    turn = pose.orientation
    if abs(pose.sample_ns) > MAX_NUMBER or not 0.5 < math.hypot(turn.x, turn.y, turn.z, turn.w) < 2:
        raise other_version(key)
    return pose


def _track(poses: Poses, n_rows: int) -> PoseTrack:
    rows = np.zeros((n_rows, 8))
    # the unit quaternion, where there is no pose at all
    rows[:, 6] = 1.0
    if poses:
        numbers = np.array(sorted(poses))
        values = np.array([poses[number] for number in numbers.tolist()])
        before = np.searchsorted(numbers, np.arange(n_rows), side="right") - 1
        rows = values[np.maximum(before, 0)]
    return PoseTrack(rows[:, :3], rows[:, 3:7], rows[:, 7])
