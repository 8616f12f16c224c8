"""Geometry and links of the simulated arm: the Denavit-Hartenberg table of a da Vinci arm, and its links' masses.

Joints: outer yaw, outer pitch, insertion, roll, wrist pitch, wrist yaw, jaw. The first three and the shaft meet in
the remote centre of motion, the origin of the base frame; at zero the shaft points along -z. Modified convention
(Craig): ``T = Rot_x(alpha) Trans_x(a) Rot_z(theta) Trans_z(d)``, so a joint's axis is the z axis of its own frame.

Source: the da Vinci Research Kit's user guide and configuration of the PSM with the Large Needle Driver 400006;
Kazanzides et al., "An open-source research kit for the da Vinci surgical system", ICRA 2014. The jaw turns about the
wrist's yaw axis.
"""

from math import pi
from typing import Final

import numpy as np

from tis.patient_side.linear_system import Array

JOINTS: Final = ("outer_yaw", "outer_pitch", "insertion", "roll", "wrist_pitch", "wrist_yaw", "jaw")
N_JOINTS: Final = len(JOINTS)
INSERTION: Final = 2
"""The joint that slides; all others turn."""

RCC_M: Final = 0.4318
"""Distance from the remote centre to the zero of the insertion."""
TOOL_M: Final = 0.4162
"""Length of the instrument's shaft, to the wrist's pitch axis."""
PITCH_TO_YAW_M: Final = 0.0091
"""Distance between the two axes of the wrist."""
YAW_TO_TIP_M: Final = 0.0102
"""Distance from the wrist's yaw axis to the control point between the jaws."""

_RIGHT: Final = pi / 2.0
ALPHA_RAD: Final = np.array([_RIGHT, -_RIGHT, _RIGHT, 0.0, -_RIGHT, -_RIGHT, 0.0])
A_M: Final = np.array([0.0, 0.0, 0.0, 0.0, 0.0, PITCH_TO_YAW_M, 0.0])
THETA_RAD: Final = np.array([_RIGHT, -_RIGHT, 0.0, 0.0, -_RIGHT, -_RIGHT, 0.0])
D_M: Final = np.array([0.0, 0.0, -RCC_M, TOOL_M, 0.0, 0.0, 0.0])

# The arm's travel as configured in the research kit. The wrist's joint is kept 30 mm from the remote centre, where
# the shaft's direction would be undefined: RCC - TOOL = 15.6 mm of insertion bring it there.
LOW: Final = np.array([*np.radians([-91.0, -53.0]), 0.0456, *np.radians([-260.0, -80.0, -80.0, -20.0])])
HIGH: Final = np.array([*np.radians([91.0, 53.0]), 0.24, *np.radians([260.0, 80.0, 80.0, 80.0])])
"""Limits of the joints (7,), in rad, of the insertion in m."""

TIP: Final = np.array(
    [[0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, YAW_TO_TIP_M], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
"""The control point (4, 4) in the frame of the wrist's yaw, with the axes of the da Vinci's own interface.

Its z axis points along the closed jaws, its x axis against the wrist's yaw axis; so are JIGSAWS's orientations.
"""
TIP_LINK: Final = 5
GRAVITY_M_S2: Final = np.array([0.0, 0.0, -9.81])


def link_transforms(joints: Array) -> Array:
    """Return each link's frame in that of the link before it.

    Parameters
    ----------
    joints
        Positions (..., 7) of the joints, in rad, of the insertion in m.

    Returns
    -------
    Array
        Homogeneous transforms (..., 7, 4, 4).

    Notes
    -----
    Craig, *Introduction to Robotics* (3rd ed.), equation 3.6. Oracle: products of SciPy's rotations, and MuJoCo's
    forward kinematics, test_arm_geometry.
    """
    slides = np.arange(N_JOINTS) == INSERTION
    theta = THETA_RAD + np.where(slides, 0.0, joints)
    d = D_M + np.where(slides, joints, 0.0)
    c, s = np.cos(theta), np.sin(theta)
    ca, sa = np.rint(np.cos(ALPHA_RAD)), np.rint(np.sin(ALPHA_RAD))  # all twists are multiples of 90 degrees
    moves = np.zeros((*np.shape(joints), 4, 4))
    moves[..., 0, 0], moves[..., 0, 1], moves[..., 0, 3] = c, -s, A_M
    moves[..., 1, 0], moves[..., 1, 1], moves[..., 1, 2], moves[..., 1, 3] = s * ca, c * ca, -sa, -sa * d
    moves[..., 2, 0], moves[..., 2, 1], moves[..., 2, 2], moves[..., 2, 3] = s * sa, c * sa, ca, ca * d
    moves[..., 3, 3] = 1.0
    return moves


def link_frames(joints: Array) -> list[Array]:
    """Return the seven links' frames in the base, homogeneous transforms (..., 4, 4), for joints (..., 7)."""
    moves = link_transforms(joints)
    frames = [moves[..., 0, :, :]]
    for i in range(1, N_JOINTS):
        frames.append(frames[-1] @ moves[..., i, :, :])
    return frames


def tip_frame(joints: Array) -> Array:
    """Return the control point's frame in the base, a homogeneous transform (..., 4, 4), for joints (..., 7)."""
    return np.asarray(link_frames(joints)[TIP_LINK] @ TIP)


# Masses, inertias, friction and motors of the simulated arm's links.
#
# They are assumptions of the right size, not those of one arm: aluminium links of a few hundred grams, a tool of 10
# g, a carriage of half a kilogram, torques as the research kit's amplifiers give them. The da Vinci arm's
# parallelogram, counterweight and springs are left out: the arm is a chain of seven links, and its motors carry its
# weight. Published identifications (Wang et al., "A convex optimization-based dynamic model identification package
# for the da Vinci Research Kit", RA-L 4(4), 2019; Fontanelli et al., IROS 2017) have such orders of size.

MASS_KG: Final = np.array([1.6, 1.1, 0.55, 0.08, 0.012, 0.008, 0.006])
"""Masses (7,) of the links."""

COM_M: Final = np.array(
    [
        [0.010, -0.030, 0.080],
        [-0.060, 0.020, -0.110],
        [0.015, -0.040, -0.030],
        [0.001, 0.002, -0.120],
        [0.004, 0.0005, -0.0005],
        [0.0005, 0.005, 0.0006],
        [0.0008, 0.006, -0.0004],
    ]
)
"""Centres of mass (7, 3) in the links' frames."""

INERTIA_KG_M2: Final = np.array(
    [
        [1.2e-2, 1.4e-2, 6.0e-3],
        [9.0e-3, 1.1e-2, 5.0e-3],
        [2.4e-3, 2.0e-3, 1.1e-3],
        [3.0e-4, 3.0e-4, 8.0e-6],
        [2.2e-6, 3.0e-6, 2.6e-6],
        [1.4e-6, 1.0e-6, 1.6e-6],
        [1.2e-6, 7.0e-7, 1.3e-6],
    ]
)
"""Principal moments (7, 3) about the centres of mass; the principal axes are those of the links' frames."""

MOTOR_INERTIA: Final = np.array([0.02, 0.02, 0.30, 4.0e-4, 2.0e-4, 2.0e-4, 2.0e-4])
"""Inertia (7,) of the motors, seen at the joint, in kg m^2, of the insertion in kg."""

VISCOUS: Final = np.array([0.30, 0.30, 2.0, 6.0e-3, 4.0e-3, 4.0e-3, 4.0e-3])
"""Viscous friction (7,), in N m s/rad, of the insertion in N s/m."""

COULOMB: Final = np.array([0.12, 0.12, 0.60, 3.0e-3, 2.0e-3, 2.0e-3, 2.0e-3])
"""Coulomb friction (7,), in N m, of the insertion in N."""

MAX_FORCE: Final = np.array([17.0, 17.0, 60.0, 1.0, 0.6, 0.6, 0.6])
"""Largest torque (7,) of the motors, in N m, of the insertion's in N."""
