from dataclasses import replace

import pytest

from tests.patient_side.arm_models import static_model
from tis.common.errors import DataError
from tis.common.scenario.reading import build_scenario
from tis.common.scenario.source import SyntheticSource
from tis.common.sources.synthetic import synthesise
from tis.patient_side.build import choose_models

RECORDING = synthesise(SyntheticSource(kind="synthetic"), 1, 30, 100, 0)
RAW = {"version": 1, "name": "s", "duration_s": 3, "source": {"kind": "synthetic"}}


def test_a_model_of_the_arm_that_the_hand_drives_is_taken() -> None:
    model = static_model()
    other = replace(model, hand="right", arm="PSM2")  # of a hand that does not play
    assert choose_models(build_scenario(RAW, "s"), [other, model], "m.json", RECORDING) == (model,)


def test_a_model_of_another_arm_is_refused_with_both() -> None:
    wrong = replace(static_model(), arm="PSM1", rate_hz=50)
    with pytest.raises(DataError) as caught:
        choose_models(build_scenario(RAW, "s"), [wrong], "m.json", RECORDING)
    assert [str(fault) for fault in caught.value.faults] == [
        "m.json: rate_hz: must be the scenario's 30 (got 50)",
        "m.json: arm: must be PSM2, which the left hand drives in this run: a model file serves runs with the "
        "pairing that it was identified with (source.pairing, or drives of a table's columns) (got 'PSM1')",
    ]


def test_a_replay_has_no_recording_to_hold_the_arm_against() -> None:
    model = replace(static_model(), arm="PSM1")
    assert choose_models(build_scenario(RAW, "s"), [model], "model.json") == (model,)
