"""The simulated arm as MuJoCo reads it, written from its table of kinematics and of links."""

from math import cos, sin
from typing import Final

import numpy as np

from tis.patient_side.linear_system import Array
from tis.patient_side.plant.arm_geometry import (
    A_M,
    ALPHA_RAD,
    COM_M,
    COULOMB,
    D_M,
    GRAVITY_M_S2,
    HIGH,
    INERTIA_KG_M2,
    INSERTION,
    JOINTS,
    LOW,
    MASS_KG,
    MAX_FORCE,
    MOTOR_INERTIA,
    N_JOINTS,
    THETA_RAD,
    TIP,
    TIP_LINK,
    VISCOUS,
)

_MARGIN: Final = np.where(np.arange(N_JOINTS) == INSERTION, 0.01, np.radians(5.0))
"""The joints' hard stops lie this far beyond the limits of the set points."""


def arm_mjcf(timestep_s: float, friction: float, stiffness: Array, damping: Array) -> str:
    """Return the arm's model in MuJoCo's format, MJCF.

    Parameters
    ----------
    timestep_s
        Step of the physics, in s.
    friction
        Viscous and Coulomb friction as a multiple of the model's.
    stiffness, damping
        Gains (7,) of the joints' position loops, in N m/rad and N m s/rad, of the insertion in N/m and N s/m.

    Notes
    -----
    The position loop's torque is ``stiffness (set point - q) - damping q'`` plus the weight of the links, which the
    controller knows, within the largest torque. ``implicitfast`` integrates damping implicitly.
    """
    bodies, ends = [], []
    for i, joint in enumerate(JOINTS):
        bodies.append(_body(i, joint, timestep_s, friction))
        ends.append("</body>")
    motors = [
        f'<position joint="{joint}" kp="{stiffness[i]:.17g}" kv="{damping[i]:.17g}" inheritrange="0"/>'
        for i, joint in enumerate(JOINTS)
    ]
    gravity = _numbers(GRAVITY_M_S2)
    return "\n".join(
        [
            '<mujoco model="instrument arm">',
            '<compiler angle="radian" autolimits="true" balanceinertia="false"/>',
            f'<option timestep="{timestep_s:.17g}" gravity="{gravity}" integrator="implicitfast"/>',
            "<worldbody>",
            *bodies,
            *ends,
            "</worldbody>",
            "<actuator>",
            *motors,
            "</actuator>",
            "</mujoco>",
        ]
    )


def _body(i: int, joint: str, timestep_s: float, friction: float) -> str:
    """Return the opening of a link's body at joint position zero, with its joint and its inertia."""
    # Modified Denavit-Hartenberg: Rot_x(alpha) Trans_x(a) Rot_z(theta) Trans_z(d).
    twist, turn = ALPHA_RAD[i] / 2.0, THETA_RAD[i] / 2.0
    quaternion = (
        cos(twist) * cos(turn),
        sin(twist) * cos(turn),
        -sin(twist) * sin(turn),
        cos(twist) * sin(turn),
    )
    place_m = (A_M[i], -sin(ALPHA_RAD[i]) * D_M[i], cos(ALPHA_RAD[i]) * D_M[i])
    kind = "slide" if i == INSERTION else "hinge"
    low, high = LOW[i] - _MARGIN[i], HIGH[i] + _MARGIN[i]
    force = MAX_FORCE[i]
    lines = [
        f'<body name="{joint}" pos="{_numbers(place_m)}" quat="{_numbers(quaternion)}" gravcomp="1">',
        f'<inertial mass="{MASS_KG[i]:.17g}" pos="{_numbers(COM_M[i])}" diaginertia="{_numbers(INERTIA_KG_M2[i])}"/>',
        f'<joint name="{joint}" type="{kind}" axis="0 0 1" range="{low:.17g} {high:.17g}" '
        f'solreflimit="{2.0 * timestep_s:.17g} 1" solimplimit="0.95 0.99 0.001" '
        f'solreffriction="{2.0 * timestep_s:.17g} 1" solimpfriction="0.99 0.99 0.001" '
        f'actuatorfrcrange="{-force:.17g} {force:.17g}" actuatorgravcomp="true" '
        f'armature="{MOTOR_INERTIA[i]:.17g}" damping="{friction * VISCOUS[i]:.17g}" '
        f'frictionloss="{friction * COULOMB[i]:.17g}"/>',
    ]
    if i == TIP_LINK:
        # the axes of TIP
        lines.append(f'<site name="tip" pos="{_numbers(TIP[:3, 3])}" quat="0.5 -0.5 0.5 0.5"/>')
    return "\n".join(lines)


def _numbers(values: Array | tuple[float, ...]) -> str:
    return " ".join(f"{value:.17g}" for value in values)
