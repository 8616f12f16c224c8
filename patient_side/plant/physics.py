"""Physics of the simulated arm: whole steps of MuJoCo from a state that is an array.

MuJoCo's model and data are scratch space: every call begins by writing the whole state, so a result depends on
nothing but its arguments, bit for bit.
"""

from collections.abc import Callable, Sequence
from functools import cache
from importlib.util import find_spec
from math import pi
from typing import Any, NamedTuple

import numpy as np

from tis.common.errors import Fault, InputError
from tis.common.extras import GET_SIM
from tis.common.scenario import Scenario
from tis.common.scenario.patient import MujocoPlant
from tis.patient_side.linear_system import Array
from tis.patient_side.plant.arm_geometry import INSERTION, N_JOINTS, VISCOUS
from tis.patient_side.plant.mjcf import arm_mjcf

# The optional package that simulates an arm.


def check_plant(scenario: Scenario) -> None:
    """Raise `InputError` where this installation cannot move the scenario's arm."""
    if scenario.patient.plant.kind == "mujoco":
        check_simulator()


def check_simulator() -> None:
    """Raise `InputError` where MuJoCo is missing, which simulates the arm."""
    if find_spec("mujoco") is None:
        raise InputError(Fault("patient.plant", "kind", f"mujoco needs the package mujoco: {GET_SIM}"))


class Moved(NamedTuple):
    """The arm after some steps: the state, and positions (7,) of the joints, in rad, of the insertion in m."""

    state: Array
    joints: Array


Force = Callable[[Array, Array], Array]


class Motion(NamedTuple):
    """Joints that follow set points, at each step of the physics.

    Positions and motor torques (N, 7), in rad and N m, those of the insertion in m and N. A torque is the one that
    acts until the next step.
    """

    joints: Array
    torque: Array


class ArmPhysics:
    """A simulated arm with position loops of the scenario's bandwidth. Raises `InputError` without MuJoCo.

    Parameters
    ----------
    spec
        The scenario's arm.

    Notes
    -----
    Oracles: the energy of the arm without motors and friction, the position loop's differential equation, and equal
    states from equal arguments, test_physics.
    """

    def __init__(self, spec: MujocoPlant) -> None:
        check_simulator()
        stiffness, damping = loop_gains(spec)
        self._loop_damping = damping
        self._mujoco, self.model = _compiled(1.0 / spec.physics_hz, spec.friction, stiffness, damping)
        self._data = self._mujoco.MjData(self.model)
        self._parts = self._mujoco.mjtState.mjSTATE_INTEGRATION
        self._size = self._mujoco.mj_stateSize(self.model, self._parts)

    def at_rest(self, joints: Array) -> Array:
        """Return the state of an arm that rests at ``joints`` (7,), which are its set point."""
        self._mujoco.mj_resetData(self.model, self._data)
        self._data.qpos[:] = joints
        self._data.ctrl[:] = joints
        self._mujoco.mj_forward(self.model, self._data)
        return self._state()

    def advance(self, state: Array, set_point: Array, n_steps: int) -> Moved:
        """Return the arm after ``n_steps`` (>= 0) steps with the set point (7,) of its joints."""
        self._mujoco.mj_setState(self.model, self._data, state, self._parts)
        self._data.ctrl[:] = set_point
        if n_steps:
            self._mujoco.mj_step(self.model, self._data, n_steps)
        return Moved(self._state(), self._data.qpos.copy())

    def press(self, state: Array, set_point: Array, n_steps: int, force: Force) -> tuple[Moved, Array]:
        """Return the arm after steps in which ``force`` acts on the tip, and the tip's velocity (3,) in m/s.

        ``force`` gives the force (3,) in N for a position (3,) in m and a velocity (3,) in m/s, all in the base.
        """
        mujoco, data = self._mujoco, self._data
        mujoco.mj_setState(self.model, data, state, self._parts)
        data.ctrl[:] = set_point
        tip, jacobian = self.model.site("tip").id, np.empty((3, N_JOINTS))
        for _ in range(n_steps):
            mujoco.mj_step1(self.model, data)
            mujoco.mj_jacSite(self.model, data, jacobian, None, tip)
            data.qfrc_applied[:] = jacobian.T @ force(data.site_xpos[tip], jacobian @ data.qvel)
            mujoco.mj_step2(self.model, data)
        data.qfrc_applied[:] = 0.0
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        mujoco.mj_jacSite(self.model, data, jacobian, None, tip)
        return Moved(self._state(), data.qpos.copy()), jacobian @ data.qvel

    def follow(self, state: Array, set_points: Array) -> Motion:
        """Return the motion of an arm whose joints get the set points (N, 7), one at each step."""
        data, found = self._data, Motion(np.empty(set_points.shape), np.empty(set_points.shape))
        self._mujoco.mj_setState(self.model, data, state, self._parts)
        for k, set_point in enumerate(set_points):
            data.ctrl[:] = set_point
            found.joints[k], before = data.qpos, data.qvel.copy()
            self._mujoco.mj_step(self.model, data)
            # implicit integration damps by the velocity at the step's end
            found.torque[k] = data.qfrc_actuator - self._loop_damping * (data.qvel - before)
        return found

    def _state(self) -> Array:
        state = np.empty(self._size)
        self._mujoco.mj_getState(self.model, self._data, state, self._parts)
        return state


def loop_gains(spec: MujocoPlant) -> tuple[Array, Array]:
    """Return stiffness and damping (7,) that give each joint alone, at the home pose, the loop that is asked for.

    ``M q'' = k (r - q) - (d + viscous) q'`` with ``k = M w^2`` and ``d + viscous = 2 zeta w M``.
    """
    none = np.zeros(N_JOINTS)
    mujoco, model = _compiled(1.0 / spec.physics_hz, 0.0, none, none)
    data = mujoco.MjData(model)
    data.qpos[INSERTION] = spec.insertion_m
    mujoco.mj_forward(model, data)
    inertia = mass_matrix(mujoco, model, data).diagonal()
    w = 2.0 * pi * spec.bandwidth_hz
    damping = np.maximum(2.0 * spec.damping * w * inertia - spec.friction * VISCOUS, 0.0)
    return inertia * w**2, damping


def mass_matrix(mujoco: Any, model: Any, data: Any) -> Array:
    """Return the mass matrix (7, 7) at the positions that ``data`` holds."""
    found = np.empty((N_JOINTS, N_JOINTS))
    for i, direction in enumerate(np.eye(N_JOINTS)):
        mujoco.mj_mulM(model, data, found[i], direction)
    return found


def _compiled(timestep_s: float, friction: float, stiffness: Array, damping: Array) -> tuple[Any, Any]:
    return _compile(timestep_s, friction, tuple(stiffness.tolist()), tuple(damping.tolist()))


@cache
def _compile(
    timestep_s: float, friction: float, stiffness: Sequence[float], damping: Sequence[float]
) -> tuple[Any, Any]:
    """Return MuJoCo and the compiled model, which nobody changes."""
    import mujoco  # late: a run with another arm needs not have it

    text = arm_mjcf(timestep_s, friction, np.array(stiffness), np.array(damping))
    return mujoco, mujoco.MjModel.from_xml_string(text)
