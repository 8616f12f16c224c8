import numpy as np
import pytest

from tis.patient_side.dynamics.parameters import base_parameters, regressor, true_parameters
from tis.patient_side.plant.arm_geometry import HIGH, LOW


def test_the_base_parameters_give_all_torques() -> None:
    base, rng = base_parameters(), np.random.default_rng(5)
    q, v, a = rng.uniform(LOW, HIGH, (50, 7)), rng.normal(0, 1, (50, 7)), rng.normal(0, 5, (50, 7))
    full, values = regressor(q, v, a), true_parameters(1.0)
    assert full[:, :, base.independent] @ (base.combine @ values) == pytest.approx(full @ values, abs=1e-9)


def test_they_are_as_many_as_the_regressor_has_rank() -> None:
    base, rng = base_parameters(), np.random.default_rng(6)
    q, v, a = rng.uniform(LOW, HIGH, (200, 7)), rng.normal(0, 1, (200, 7)), rng.normal(0, 5, (200, 7))
    stacked = regressor(q, v, a).reshape(-1, 91)
    stacked = stacked / np.maximum(np.linalg.norm(stacked, axis=0), 1e-12)
    singular = np.linalg.svd(stacked, compute_uv=False)
    assert len(base.independent) == 61 == int((singular > 1e-9 * singular[0]).sum())


def test_standard_parameters_that_combine_to_the_same_give_the_same_torques() -> None:
    base, rng = base_parameters(), np.random.default_rng(7)
    _, _, right = np.linalg.svd(base.combine)
    unseen = right[61:].T @ rng.normal(size=30)
    q, v, a = (rng.normal(size=(5, 7)) for _ in range(3))
    assert np.linalg.norm(unseen) > 1.0
    assert regressor(q, v, a) @ unseen == pytest.approx(np.zeros((5, 7)), abs=1e-8)


def test_names_say_what_is_joined() -> None:
    base = base_parameters()
    assert base.names()[1] == "my_1 + mz_2"
    assert base.terms()[14] == "m_3 + m_4 + m_5 + m_6 + m_7"
    assert base.names()[14] == "m_3 + m_4 + 3 more"
