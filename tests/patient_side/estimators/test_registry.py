from typing import get_args

import pytest

from common.scenario.estimator_names import EstimatorName
from patient_side.estimators.registry import build_estimator
from tests.patient_side.arm_models import static_model


@pytest.mark.parametrize("name", get_args(EstimatorName))
def test_every_name_of_a_scenario_has_its_estimator(name: EstimatorName) -> None:
    assert build_estimator(name, static_model()).name == name
