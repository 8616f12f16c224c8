import numpy as np
import pytest

from tis.common.errors import InputError
from tis.common.runtime.recordings import load_movement, load_recording, load_training
from tis.deploy.run.resolve import resolve


def test_of_a_live_source_only_the_hands_are_known() -> None:
    movement = load_movement(resolve("live", ["source.hands=[left, right]"]))
    assert [(hand.hand, hand.arm) for hand in movement.hands] == [("left", "PSM2"), ("right", "PSM1")]
    assert len(movement) == 0


def test_what_needs_rows_refuses_a_live_source() -> None:
    with pytest.raises(InputError, match=r"source\.kind: must be recorded or synthetic here"):
        load_recording(resolve("live"))


def test_the_models_of_a_live_run_are_trained_on_the_synthetic_hand() -> None:
    scenario = resolve("live", ["identification.train_samples=200"])
    (rows,) = load_training(scenario, load_movement(scenario))
    assert len(rows) == 200
    noisy = resolve("live", ["identification.train_samples=200", "identification.sensor_noise_mm=2"])
    (blurred,) = load_training(noisy, load_movement(noisy))
    error_m = blurred.hands[0].command.position_m - rows.hands[0].command.position_m
    assert 0.0018 < np.std(error_m) < 0.0022


def test_other_sources_are_as_before() -> None:
    scenario = resolve("default", ["identification.train_samples=100"], None, 1.0)
    movement = load_movement(scenario)
    assert len(movement) == 100 + 30 + 1
    (rows,) = load_training(scenario, movement)
    assert len(rows) == 100
