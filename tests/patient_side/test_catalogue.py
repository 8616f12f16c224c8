from typing import get_args

import pytest

from tests.patient_side.arm_models import static_model
from tis.common.scenario.estimator_names import EstimatorName
from tis.patient_side.catalogue import build_estimator


@pytest.mark.parametrize("name", get_args(EstimatorName))
def test_every_name_of_a_scenario_has_its_estimator(name: EstimatorName) -> None:
    assert build_estimator(name, static_model()).name == name
