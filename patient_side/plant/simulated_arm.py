"""The simulated arm: joints that MuJoCo moves, driven by set points through its inverse kinematics."""

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import ndtri

from tis.common.streams import Stream
from tis.common.units import NS_PER_S
from tis.common.vector import Vector
from tis.patient_side.linear_system import Array
from tis.patient_side.plant.arm_geometry import INSERTION, N_JOINTS, tip_frame
from tis.patient_side.plant.environment import Environment
from tis.patient_side.plant.inverse_kinematics import Reached, joints_for
from tis.patient_side.plant.physics import ArmPhysics
from tis.patient_side.plant.protocol import PlantOutput, Reference

# Place of the scenario's positions in the workspace of the simulated arm.


class Registration(NamedTuple):
    """A rigid motion (4, 4) from the scenario's frame to the arm's base, and back.

    The first set point is mapped to the arm's home pose: the arm stands where its tip hangs straight below the remote
    centre, with a straight wrist, when the run begins. Distances, angles and speeds stay as they are.
    """

    to_base: Array
    from_base: Array

    @classmethod
    def at_home(cls, first: Reference, home: Array) -> Self:
        """Return the motion that brings the first set point, with its orientation, to the home pose (4, 4)."""
        to_base = home @ inverse(pose(first))
        return cls(to_base, inverse(to_base))


def pose(reference: Reference) -> Array:
    """Return a set point as a homogeneous transform (4, 4); its orientation must be known."""
    assert reference.orientation is not None
    found = np.eye(4)
    found[:3, :3] = Rotation.from_quat(reference.orientation).as_matrix()
    found[:3, 3] = reference.position_m
    return found


def orientation_of(frame: Array) -> Array:
    """Return the orientation of a homogeneous transform (4, 4) as a unit quaternion (4,) x, y, z, w."""
    return np.asarray(Rotation.from_matrix(frame[:3, :3]).as_quat())


def inverse(motion: Array) -> Array:
    """Return the inverse of a rigid motion (4, 4). Oracle: NumPy's inverse."""
    found = np.eye(4)
    found[:3, :3] = motion[:3, :3].T
    found[:3, 3] = -motion[:3, :3].T @ motion[:3, 3]
    return found


def _triple(values: Array) -> Vector:
    x, y, z = values.tolist()
    return x, y, z


class ArmState(NamedTuple):
    """State of the physics, its number of steps since the run's epoch, and the set point in force.

    ``orientation`` (4,) is that of the set point, ``reached`` are its joints, ``surface_m`` is a point of the surface
    that the arm touches.
    """

    physics: Array
    n_steps: int
    registration: Registration
    orientation: Array
    reached: Reached
    surface_m: Vector | None = None


@dataclass(frozen=True)
class SimulatedArm:
    """A simulated arm whose physics takes whole steps, beside the ticks.

    The first set point with an orientation becomes the home pose, where the arm rests (`Registration`); before it
    there is no arm. At a tick the arm stands where its last whole step of ``1 / physics_hz`` has brought it, at most
    one step earlier. The noise of joint j at tick k is element ``7 k + j`` of the stream; it is that of the readings,
    the position loops are free of it. ``noise_std`` (7,) is in rad, of the insertion in m.

    Oracles: the servo's differential equation for small movements, and equal states from equal set points,
    test_simulated_arm.
    """

    physics: ArmPhysics
    physics_hz: int
    insertion_m: float
    noise_std: Array
    noise: Stream
    environment: Environment | None = None

    def initial(self) -> ArmState | None:
        """Return the state before the first set point: none."""
        return None

    def step(
        self, state: ArmState | None, reference: Reference | None, tick: int, now_ns: int
    ) -> tuple[ArmState | None, PlantOutput | None]:
        """Return the arm at ``now_ns``, moved from the last tick's state towards the last set point."""
        n_steps = max(now_ns, 0) * self.physics_hz // NS_PER_S
        if state is None:
            if reference is None or reference.orientation is None:
                return None, None
            state = self._at_home(reference, n_steps)
        # the movement until now, by the set point of the tick before
        physics, joints, force_n = self._moved(state, max(n_steps - state.n_steps, 0))
        where = state.registration.from_base @ tip_frame(joints)
        read = joints + self._reading_error(tick)
        measured = state.registration.from_base @ tip_frame(read) if self.noise_std.any() else where
        output = PlantOutput(
            where[:3, 3],
            measured[:3, 3],
            orientation_of(measured),
            float(read[-1]),
            state.reached.is_clamped,
            force_n,
        )
        # the set point from now on
        orientation, reached = state.orientation, state.reached
        if reference is not None:
            orientation = orientation if reference.orientation is None else reference.orientation
            target = state.registration.to_base @ pose(reference._replace(orientation=orientation))
            reached = joints_for(target, reference.gripper_rad, reached.joints)
        return ArmState(physics, n_steps, state.registration, orientation, reached, state.surface_m), output

    def _moved(self, state: ArmState, n_steps: int) -> tuple[Array, Array, Vector | None]:
        """Return the arm after some steps: its physics, its joints, and the force on its tip."""
        environment, surface_m = self.environment, state.surface_m
        if environment is None or surface_m is None:
            return *self.physics.advance(state.physics, state.reached.joints, n_steps), None
        back, to = state.registration.from_base, state.registration.to_base[:3, :3]

        def force(position: Array, velocity: Array) -> Vector:
            """Return the force in the scenario's frame."""
            at, speed = back[:3, :3] @ position + back[:3, 3], back[:3, :3] @ velocity
            return environment.force(surface_m, _triple(at), _triple(speed))

        moved, velocity = self.physics.press(
            state.physics, state.reached.joints, n_steps, lambda at, speed: to @ np.array(force(at, speed))
        )
        return moved.state, moved.joints, force(tip_frame(moved.joints)[:3, 3], velocity)

    def _at_home(self, first: Reference, n_steps: int) -> ArmState:
        joints = np.zeros(N_JOINTS)
        joints[INSERTION] = self.insertion_m
        home = tip_frame(joints)
        reached = joints_for(home, first.gripper_rad, joints)
        assert first.orientation is not None
        physics = self.physics.at_rest(reached.joints)
        surface_m = None if self.environment is None else self.environment.surface_m(_triple(first.position_m))
        return ArmState(physics, n_steps, Registration.at_home(first, home), first.orientation, reached, surface_m)

    def _reading_error(self, tick: int) -> Array:
        if not self.noise_std.any():
            return np.zeros(N_JOINTS)
        return np.asarray(self.noise_std * ndtri(self.noise.uniforms(N_JOINTS * tick, N_JOINTS)))
