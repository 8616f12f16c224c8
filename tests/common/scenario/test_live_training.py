import pytest

from tis.common.errors import InputError
from tis.common.estimators import scenario_name
from tis.common.scenario.identification import Identification


def test_a_live_run_waits_for_no_training() -> None:
    named = ["hold", scenario_name("cnn"), scenario_name("gpr")]
    for train in ("own_head", "others"):
        with pytest.raises(InputError) as caught:
            Identification(train=train).check_for_live_runs(named)
        (fault,) = caught.value.faults
        assert str(fault) == (
            "identification: train: must be a model file in a live run with cnn and gpr, as training takes "
            "minutes: `tis identify --set identification.method=cnn --out FILE.safetensors` "
            f"(got '{train}')"
        )
        Identification(train=train).check_for_live_runs(["hold", "innovations_kf"])
    Identification(train="m.safetensors").check_for_live_runs(named)
