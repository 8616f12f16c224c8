from importlib.util import find_spec

import numpy as np
import pytest

from tis.common.errors import InputError
from tis.common.extras import GET_DYNAMICS
from tis.patient_side.dynamics import consistent_fit as module
from tis.patient_side.dynamics.consistent_fit import check_solver, consistent_fit
from tis.patient_side.dynamics.parameters import (
    NAMES,
    base_parameters,
    joints,
    links,
    pseudo_inertia,
    regressor,
    true_parameters,
)
from tis.patient_side.linear_system import Array
from tis.patient_side.plant.arm_geometry import HIGH, LOW

SOLVER = pytest.mark.skipif(
    find_spec("cvxpy") is None or find_spec("clarabel") is None,
    reason="the extra dynamics is not installed",
)


def random_rows(n: int) -> tuple[Array, Array]:
    """Regressor of the base parameters and weights that make each joint's torque about 1."""
    rng = np.random.default_rng(9)
    q, v, a = rng.uniform(LOW, HIGH, (n, 7)), rng.normal(0, 1.5, (n, 7)), rng.normal(0, 10, (n, 7))
    full = regressor(q, v, a)
    rms = np.sqrt(np.mean((full @ true_parameters(1.0)) ** 2, axis=0))
    base = base_parameters()
    return full.reshape(-1, 91)[:, base.independent], np.tile(1.0 / rms, n)


@SOLVER
def test_exact_torques_give_their_base_parameters_back() -> None:
    base, values = base_parameters(), true_parameters(1.0)
    matrix, weight = random_rows(400)
    torque = matrix @ (base.combine @ values)
    found = base.combine @ consistent_fit(matrix * weight[:, None], torque * weight, base)
    true = base.combine @ values
    heavy = np.abs(true) > 1e-6  # products of inertia of parts of a few grams drown in the solver's tolerance
    assert found[heavy] == pytest.approx(true[heavy], rel=0.02)
    assert matrix @ found * weight == pytest.approx(torque * weight, abs=1e-4)


@SOLVER
def test_the_fit_exists_as_bodies_where_least_squares_does_not() -> None:
    base, values = base_parameters(), true_parameters(1.0)
    matrix, weight = random_rows(60)
    impossible = values.copy()
    impossible[NAMES.index("viscous_2")] = -0.2
    impossible[NAMES.index("Izz_7")] = -1e-4
    torque = matrix @ (base.combine @ impossible)
    plain = np.linalg.lstsq(matrix * weight[:, None], torque * weight)[0]
    assert plain[base.names().index("viscous_2")] == pytest.approx(-0.2, abs=1e-6)
    found = consistent_fit(matrix * weight[:, None], torque * weight, base)
    assert (joints(found) >= -1e-9).all()
    for link in links(found):
        assert np.linalg.eigvalsh(pseudo_inertia(link))[0] > 0.0


def test_a_missing_solver_is_named_with_its_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "find_spec", lambda name: None if name == "cvxpy" else object())
    with pytest.raises(InputError) as caught:
        check_solver()
    assert str(caught.value) == (f"tis identify: --dynamics: needs the package cvxpy: {GET_DYNAMICS}")
