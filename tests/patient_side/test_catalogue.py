import pytest

from tests.patient_side.arm_models import static_model
from tis.common.estimators import ESTIMATORS, scenario_name
from tis.patient_side.estimators.builders import build_estimator


@pytest.mark.parametrize("name", ESTIMATORS)
def test_every_name_of_a_scenario_has_its_estimator(name: str) -> None:
    assert build_estimator(scenario_name(name), static_model()).name == scenario_name(name)
