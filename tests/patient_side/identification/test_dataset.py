import numpy as np
import pytest

from common.errors import DataError
from patient_side.identification.dataset import training_set
from tests.patient_side.identification.known_systems import hand_like, recording


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
