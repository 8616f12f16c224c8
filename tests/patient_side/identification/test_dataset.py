from dataclasses import replace

import numpy as np
import pytest

from tests.patient_side.identification.known_systems import hand_like, recording
from tis.common.errors import DataError
from tis.patient_side.identification.dataset import training_set


def test_one_hand_is_centred_on_its_own_means() -> None:
    u, y = hand_like(50, 0) + 0.3, hand_like(50, 1) - 0.2
    other = (hand_like(50, 2), hand_like(50, 3))
    training = training_set([recording("T1", {"left": (u, y), "right": other})], "left", pool_hands=False)
    ((inputs, outputs),) = training.trials
    assert inputs == pytest.approx(u - u.mean(axis=0))
    assert outputs + training.output_offset_m == pytest.approx(y)
    assert training.input_offset_m == pytest.approx(u.mean(axis=0))
    assert np.array_equal(training.output_low_m, y.min(axis=0))
    assert np.array_equal(training.output_high_m, y.max(axis=0))
    assert (training.arm, training.rate_hz, training.labels) == ("PSM2", 30, ("T1, left hand",))


def test_pooled_hands_are_centred_each_and_the_offset_is_that_of_the_hand_asked_for() -> None:
    left = [(hand_like(40, i) + i, hand_like(40, i + 9) - i) for i in (1, 2)]
    right = (hand_like(40, 5) + 50.0, hand_like(40, 6) + 60.0)
    training = training_set(
        [recording("T1", {"left": left[0], "right": right}), recording("T2", {"left": left[1]})],
        "left",
        pool_hands=True,
    )
    assert training.labels == ("T1, left hand", "T1, right hand", "T2, left hand")
    for inputs, outputs in training.trials:
        assert inputs.mean(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
        assert outputs.mean(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
    assert training.output_offset_m == pytest.approx(np.concatenate([y for _, y in left]).mean(axis=0))
    assert training.output_high_m.max() < 10


def test_recordings_that_do_not_fit_together_are_refused_at_once() -> None:
    pair = (hand_like(40, 0), hand_like(40, 1))
    recordings = [
        recording("T1", {"left": pair}),
        recording("T2", {"left": pair}, rate_hz=60, same_name=True),
    ]
    with pytest.raises(DataError) as caught:
        training_set(recordings, "left", pool_hands=False)
    assert [str(fault) for fault in caught.value.faults] == [
        "identification: rate_hz: must be the same in all training recordings (got [30, 60])",
        "identification: pairing: the left hand must drive the same arm in all training recordings"
        " (got ['PSM1', 'PSM2'])",
    ]


def test_a_hand_that_nobody_recorded_is_named() -> None:
    pair = (hand_like(40, 0), hand_like(40, 1))
    for recordings in ([], [recording("T1", {"left": pair})]):
        with pytest.raises(DataError, match="no recording holds the right hand"):
            training_set(recordings, "right", pool_hands=True)


def test_a_trial_with_a_jump_is_its_stretches_each_about_its_mean() -> None:
    u, y = hand_like(400, 0), hand_like(400, 1)
    left, right = (u.copy(), y.copy()), (hand_like(400, 2), hand_like(400, 3))
    left[1][150:] += 0.06  # the arm's alone: its master and the other hand are cut with it
    grippers = replace(
        recording("T1", {"left": left, "right": right}).hands[0].follower, gripper_rad=np.arange(400.0)
    )
    whole = recording("T1", {"left": left, "right": right})
    whole = replace(whole, hands=(replace(whole.hands[0], follower=grippers), whole.hands[1]))
    training = training_set([whole], "left", pool_hands=True)
    assert training.labels == (
        "T1 rows 0-149, left hand",
        "T1 rows 150-399, left hand",
        "T1 rows 0-149, right hand",
        "T1 rows 150-399, right hand",
    )
    assert training.first_rows == (0, 150, 0, 150)
    assert [angles[0] for angles in training.grippers_rad] == [0.0, 150.0, 0.0, 0.0]
    assert [len(angles) for angles in training.grippers_rad] == [150, 250, 150, 250]
    for (_, outputs), rows in zip(training.trials[:2], (slice(150), slice(150, None)), strict=True):
        assert outputs == pytest.approx(left[1][rows] - left[1][rows].mean(axis=0))
    assert training.output_offset_m == pytest.approx(left[1].mean(axis=0))
    [text] = training.warnings
    assert text == "T1: trained on rows 0-149, rows 150-399, as trials of their own, and not on the jumps between"


def test_stretches_of_too_few_rows_are_left_out_with_a_word() -> None:
    u, y = hand_like(400, 0), hand_like(400, 1)
    for row in (40, 200, 201):  # before rows 40, and around row 200
        u[row:] += 0.05 if row != 201 else -0.05
    made = recording("T1", {"left": (u, y)})
    training = training_set([made], "left", pool_hands=False, shortest=60)
    assert training.labels == ("T1 rows 40-199, left hand", "T1 rows 201-399, left hand")
    [text] = training.warnings
    assert text.endswith("; left out, as shorter than 60 rows: rows 0-39, rows 200-200")
    learned = np.concatenate([y[40:200], y[201:]])
    assert training.output_offset_m == pytest.approx(learned.mean(axis=0))
    assert np.array_equal(training.output_high_m, learned.max(axis=0))
    other = recording("T2", {"left": (u[:60], y[:60])})
    with pytest.raises(DataError, match="need 60 rows between jumps: T2: trained on no rows"):
        training_set([other], "left", pool_hands=False, shortest=60)
    assert training_set([other, made], "left", pool_hands=False, shortest=60).labels == training.labels
