import pytest

from tests.patient_side.arm_models import static_model
from tis.common.scenario.estimator_names import NAMES
from tis.patient_side.estimators.builders import build_estimator


@pytest.mark.parametrize("name", NAMES)
def test_every_name_of_a_scenario_has_its_estimator(name: str) -> None:
    assert build_estimator(name, static_model()).name == name
