"""No recorded and no synthetic movement is refused by the scenario's own limits, however its packets arrive."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tis.common.messages import Pose, Quaternion, Vector3
from tis.common.runtime.recordings import load_recording
from tis.common.scenario.safety import Gate
from tis.common.sources.jigsaws import parse_trial, pose_track, position_m
from tis.common.sources.trajectory import PoseTrack
from tis.common.ticker import SendPlan
from tis.common.units import NS_PER_MS, sample_instant_ns
from tis.deploy.run.resolve import resolve
from tis.patient_side.safety.gate import StreamGate, limits_of

Array = NDArray[np.float64]

DEVICES = ("MTML", "MTMR", "PSM1", "PSM2")


def _refused(track: PoseTrack, device: str, rate_hz: int, centre_m: Array, seed: int) -> list[tuple[int, str]]:
    """Return the samples that the gate refuses when a fifth is lost and delays vary by 300 ms."""
    rng, n = np.random.default_rng(seed), len(track.position_m)
    x, y, z = centre_m.tolist()
    gate = StreamGate(SendPlan(rate_hz, n), (x, y, z), limits_of(Gate(), device.startswith("PSM")))
    k = np.flatnonzero(rng.random(n) > 0.2)
    instants = [sample_instant_ns(i, rate_hz) for i in k.tolist()]
    recv_ns = np.array(instants) + rng.integers(0, 300 * NS_PER_MS, len(k))
    found: list[tuple[int, str]] = []
    for i in np.argsort(recv_ns).tolist():
        x, y, z = track.position_m[k[i]].tolist()
        a, b, c, d = track.orientation[k[i]].tolist()
        pose = Pose(
            sample_ns=instants[i],
            position_m=Vector3(x=x, y=y, z=z),
            orientation=Quaternion(x=a, y=b, z=c, w=d),
            gripper_rad=float(track.gripper_rad[k[i]]),
        )
        kind = gate.refusal(pose, int(k[i]), int(recv_ns[i]))
        if kind is not None:
            found.append((int(k[i]), kind))
    return found


def test_of_the_recorded_trials_nothing_is_refused(jigsaws_dir: Path) -> None:
    """The centre is that of another trial, as with a model of other subjects."""
    files = sorted(jigsaws_dir.glob("*/kinematics/AllGestures/*.txt"))
    trials = [parse_trial(file.read_text(), str(file)) for file in files]
    assert trials
    for i, rows in enumerate(trials):
        for device in DEVICES:
            centre_m = position_m(trials[i - 1], device).mean(axis=0)
            track = pose_track(rows, device, files[i].name)
            assert _refused(track, device, 30, centre_m, i) == [], (files[i].name, device)


@pytest.mark.parametrize(("rate_hz", "n_seeds"), [(30, 5), (200, 1), (1000, 1)])
def test_of_synthetic_movements_nothing_is_refused(rate_hz: int, n_seeds: int) -> None:
    for seed in range(n_seeds):
        settings = (f"rate_hz={rate_hz}", "patient.tick_phase_ms=0", "source.hands=[left, right]")
        recording = load_recording(resolve("default", settings, seed, 20.0))
        for hand in recording.hands:
            for track, device in ((hand.command, "MTML"), (hand.follower, "PSM2")):
                assert _refused(track, device, rate_hz, track.position_m[0], seed) == [], seed
