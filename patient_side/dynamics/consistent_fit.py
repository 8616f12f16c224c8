"""Least squares over parameters of bodies that can exist: a semidefinite programme."""

from importlib import import_module
from importlib.util import find_spec
from typing import Any, Final

import numpy as np

from tis.common.errors import DataError, Fault, InputError
from tis.common.extras import GET_DYNAMICS
from tis.patient_side.dynamics.parameters import N_OF_LINK, PER_LINK, BaseParameters, pseudo_inertia
from tis.patient_side.linear_system import Array
from tis.patient_side.plant.arm_geometry import N_JOINTS

MASS_KG: Final = np.array([1.0, 1.0, 1.0, 0.1, 0.01, 0.01, 0.01])
LENGTH_M: Final = np.array([0.1, 0.1, 0.1, 0.1, 0.01, 0.01, 0.01])
"""Sizes of the links, in powers of ten: units in which the solver's numbers are near 1."""
_LEAST: Final = 1e-6
"""Least eigenvalue of a pseudo-inertia in these units."""


def check_solver() -> None:
    """Raise `InputError` where cvxpy is missing, which states the programme, or Clarabel, which solves it."""
    missing = [name for name in ("cvxpy", "clarabel") if find_spec(name) is None]
    if missing:
        rule = f"needs the package {' and '.join(missing)}: {GET_DYNAMICS}"
        raise InputError(Fault("tis identify", "--dynamics", rule))


def consistent_fit(matrix: Array, torque: Array, base: BaseParameters) -> Array:
    """Return standard parameters (91,) of possible bodies whose torques are nearest to those that were read.

    Parameters
    ----------
    matrix
        Regressor (N, B) of the base parameters, weighted.
    torque
        Torques (N,), weighted likewise.
    base
        The arm's base parameters. Only their values are determined: other standard parameters with the same ones fit
        as well, and the solver returns one of them.

    Raises
    ------
    DataError
        If the solver finds no solution.

    Notes
    -----
    Minimise ``|W b(p) - t|^2`` with the pseudo-inertia of each link positive definite, and motor inertia and friction
    at least 0: Wensing, Kim and Slotine, RA-L 3(1), 2018, and for the da Vinci arm Wang et al., RA-L 4(4), 2019.
    Oracle: parameters that torques were computed from, and least squares where no bound is active,
    test_consistent_fit.
    """
    cp: Any = import_module("cvxpy")  # late: only this command needs it

    units = _units()
    # the triangle of the QR decomposition holds all that the rows tell
    orthogonal, triangle = np.linalg.qr(matrix)
    target = orthogonal.T @ torque
    scale = np.linalg.norm(target)
    values = cp.Variable(N_JOINTS * PER_LINK)
    fit = (triangle @ base.combine * units / scale) @ values - target / scale
    rules: list[Any] = []
    for i in range(N_JOINTS):
        first = i * PER_LINK
        rules.append(_pseudo(values[first : first + N_OF_LINK]) >> _LEAST * np.eye(4))
        rules.append(values[first + N_OF_LINK : first + PER_LINK] >= 0)
    problem = cp.Problem(cp.Minimize(cp.norm(fit)), rules)
    try:
        problem.solve(solver=cp.CLARABEL, tol_gap_abs=1e-10, tol_gap_rel=1e-10, tol_feas=1e-10)
    except cp.error.SolverError as error:
        raise DataError(Fault("tis identify", "--dynamics", f"the solver failed: {error}")) from None
    if values.value is None:
        raise DataError(Fault("tis identify", "--dynamics", f"the solver found no solution: {problem.status}"))
    return np.asarray(values.value * units)


def _pseudo(link: Any) -> Any:
    """Return the pseudo-inertia of a link's variables (10,) as an expression: it is linear in them."""
    parts = [pseudo_inertia(unit) for unit in np.eye(N_OF_LINK)]
    return sum(part * link[k] for k, part in enumerate(parts))


def _units() -> Array:
    """Return the unit (91,) of each parameter: ``m``, ``m l``, ``m l^2``, of the joint ones that of its inertia."""
    found = np.empty((N_JOINTS, PER_LINK))
    for i, (m, length) in enumerate(zip(MASS_KG, LENGTH_M, strict=True)):
        found[i] = [m, *[m * length] * 3, *[m * length**2] * 6, *[max(m * length**2, 1e-4)] * 3]
    found[2, N_OF_LINK:] = 1.0  # the insertion's are in kg, N s/m and N
    return found.ravel()
