"""The optional package that simulates an arm."""

from importlib.util import find_spec

from tis.common.errors import Fault, InputError
from tis.common.extras import GET_SIM
from tis.common.scenario import Scenario


def check_plant(scenario: Scenario) -> None:
    """Raise `InputError` where this installation cannot move the scenario's arm."""
    if scenario.patient.plant.kind == "mujoco":
        check_simulator()


def check_simulator() -> None:
    """Raise `InputError` where MuJoCo is missing, which simulates the arm."""
    if find_spec("mujoco") is None:
        raise InputError(Fault("patient.plant", "kind", f"mujoco needs the package mujoco: {GET_SIM}"))
