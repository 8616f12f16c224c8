"""Noise of the surgeon's sensors: its moments, its addresses, and what it does not touch."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tests.nodes import a_recording
from tis.common.messages import Pose, SampledPose, decode
from tis.common.node import Emission, Record
from tis.common.records import TRUTH, TruthRow
from tis.common.sources.sensor_noise import SensorNoise, with_noise
from tis.common.ticker import Ticker
from tis.surgeon_side.motion import RecordedMotion
from tis.surgeon_side.node import ONCE, Redundancy, SurgeonNode

COMMAND = "tis/MTML/measured_cp"
ARM = "tis/PSM2/setpoint_cp"


def _sent(noise: SensorNoise | None, redundancy: Redundancy = ONCE, n_ticks: int = 5) -> list[Emission | Record]:
    node = SurgeonNode("tis", RecordedMotion(a_recording(50, 10)), Ticker(30, n_ticks), redundancy, noise=noise)
    outputs: list[Emission | Record] = []
    while (due_ns := node.next_wake_ns()) is not None:
        outputs += node.wake(due_ns)
    return outputs


def _positions(outputs: list[Emission | Record], key: str) -> list[tuple[float, float, float]]:
    poses = [decode(each.payload, Pose) for each in outputs if isinstance(each, Emission) and each.key == key]
    return [(pose.position_m.x, pose.position_m.y, pose.position_m.z) for pose in poses]


def test_the_errors_are_normal_with_the_deviation_asked_for_in_each_axis() -> None:
    noise = SensorNoise(3, 0.002)
    errors = np.array([noise.error(COMMAND, k) for k in range(20_000)])
    assert np.all(np.abs(errors.mean(axis=0)) < 4 * 0.002 / np.sqrt(20_000))
    assert np.allclose(errors.std(axis=0), 0.002, rtol=0.03)
    # 68.3 and 95.4 % of a normal variable lie within one and two deviations
    within = [np.mean(np.abs(errors) < n * 0.002) for n in (1, 2)]
    assert np.allclose(within, [0.6827, 0.9545], atol=0.006)
    assert np.all(np.abs(np.corrcoef(errors.T) - np.eye(3)) < 0.03)


@given(seed=st.integers(0, 2**32), k=st.integers(0, 10**6), before=st.lists(st.integers(0, 10**6), max_size=4))
def test_an_error_depends_on_seed_key_and_sample_alone(seed: int, k: int, before: list[int]) -> None:
    busy, fresh = SensorNoise(seed, 1.0), SensorNoise(seed, 1.0)
    for other in before:
        busy.error(COMMAND, other)
        busy.error(ARM, other)
    error = busy.error(COMMAND, k)
    assert error == fresh.error(COMMAND, k)
    assert error != fresh.error(ARM, k)
    assert error != SensorNoise(seed + 1, 1.0).error(COMMAND, k)


def test_command_and_arm_are_sent_with_their_errors_and_the_truth_without() -> None:
    noise = SensorNoise(7, 0.001)
    noisy, clean = _sent(noise), _sent(None)
    for key in (COMMAND, ARM):
        moved = np.array(_positions(noisy, key)) - np.array(_positions(clean, key))
        assert np.allclose(moved, [noise.error(key, k) for k in range(5)], atol=1e-15)
    rows = [
        [each.data for each in outputs if isinstance(each, Record) and each.topic == TRUTH]
        for outputs in (noisy, clean)
    ]
    assert rows[0] == rows[1]
    assert isinstance(rows[0][0], TruthRow)


def test_copies_and_history_carry_the_error_of_their_sample() -> None:
    outputs = _sent(SensorNoise(7, 0.001), Redundancy(copies=2, spacing_ns=10_000_000, history=2), n_ticks=4)
    seen: dict[int, set[float]] = {}
    for each in outputs:
        if isinstance(each, Emission) and each.key == COMMAND:
            pose = decode(each.payload, SampledPose)
            for one in (pose, *pose.history):
                seen.setdefault(one.sample_ns, set()).add(one.position_m.x)
    assert len(seen) == 4
    assert all(len(values) == 1 for values in seen.values())


def test_training_rows_have_the_errors_of_their_rows_and_all_else_stays() -> None:
    recording = a_recording(40)
    noisy = with_noise(recording, 0.002, 5)
    noise = SensorNoise(5, 0.002)
    (hand,), (clean,) = noisy.hands, recording.hands
    for track, before, device in (
        (hand.command, clean.command, "left master"),
        (hand.follower, clean.follower, "PSM2"),
    ):
        errors = [noise.error(f"{recording.label}/{device}", k) for k in range(40)]
        assert np.allclose(track.position_m - before.position_m, errors, atol=1e-12)
        assert np.array_equal(track.orientation, before.orientation)
    assert with_noise(recording, 0.0, 5) is recording
    assert (noisy.label, noisy.digest, noisy.start) == (recording.label, recording.digest, recording.start)


def test_of_a_longer_recording_the_first_rows_have_the_same_errors() -> None:
    short, long = (with_noise(a_recording(n), 0.002, 5).hands[0].command.position_m for n in (20, 40))
    assert np.array_equal(short, long[:20])
