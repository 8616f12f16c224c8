import numpy as np
import pytest

from tis.common.scenario.patient import MujocoPlant
from tis.patient_side.dynamics.identify import Dynamics, identify_dynamics
from tis.patient_side.dynamics.parameters import joints, links, pseudo_inertia

pytest.importorskip("mujoco", reason="the extra sim is not installed")
pytest.importorskip("cvxpy", reason="the extra dynamics is not installed")


@pytest.fixture(scope="module", params=[0.0, 0.05], ids=["clean", "noisy"])
def found(request: pytest.FixtureRequest) -> Dynamics:
    noise = {"encoder_noise_mrad": request.param, "encoder_noise_mm": 0.1 * request.param}
    return identify_dynamics(MujocoPlant.model_validate({"kind": "mujoco", **noise}), 1)


def test_the_dynamics_are_recovered_within_five_percent(found: Dynamics) -> None:
    error_pct = 100.0 * np.abs(found.identified / found.true - 1.0)
    assert found.determined.sum() >= 30
    assert error_pct[found.determined].max() < 5.0
    assert found.error_pct.max() < 5.0


def test_clean_encoders_tell_every_base_parameter() -> None:
    found = identify_dynamics(MujocoPlant(kind="mujoco", encoder_noise_mrad=0.0, encoder_noise_mm=0.0), 2)
    assert found.determined.all()
    assert np.abs(found.identified / found.true - 1.0).max() < 0.05
    assert found.error_pct.max() < 0.01


def test_what_is_not_determined_hardly_moves_the_arm(found: Dynamics) -> None:
    assert found.undetermined_pct.max() < 5.0


def test_the_identified_links_can_exist(found: Dynamics) -> None:
    assert (joints(found.values) >= -1e-9).all()
    for link in links(found.values):
        assert np.linalg.eigvalsh(pseudo_inertia(link))[0] > 0.0
