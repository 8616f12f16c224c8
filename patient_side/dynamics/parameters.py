"""Standard parameters of the arm's dynamics: of each link ten, of each joint three.

They stand link by link in one vector (91,): mass, first moments, moments of inertia about the origin of the link's
frame, then motor inertia, viscous and Coulomb friction of the link's joint.
"""

from typing import Final

import numpy as np

from tis.patient_side.plant.arm_geometry import N_JOINTS
from tis.patient_side.plant.arm_links import COM_M, COULOMB, INERTIA_KG_M2, MASS_KG, MOTOR_INERTIA, VISCOUS
from tis.patient_side.statespace import Array

OF_LINK: Final = ("m", "mx", "my", "mz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
OF_JOINT: Final = ("motor", "viscous", "coulomb")
N_OF_LINK: Final = len(OF_LINK)
PER_LINK: Final = N_OF_LINK + len(OF_JOINT)
N_PARAMETERS: Final = N_JOINTS * PER_LINK
NAMES: Final = tuple(f"{name}_{i + 1}" for i in range(N_JOINTS) for name in (*OF_LINK, *OF_JOINT))


def links(values: Array) -> Array:
    """Return the links' parameters (7, 10) of a vector (91,)."""
    return values.reshape(N_JOINTS, PER_LINK)[:, :N_OF_LINK]


def joints(values: Array) -> Array:
    """Return motor inertia, viscous and Coulomb friction (7, 3) of a vector (91,)."""
    return values.reshape(N_JOINTS, PER_LINK)[:, N_OF_LINK:]


def true_parameters(friction: float) -> Array:
    """Return the parameters (91,) that MuJoCo simulates; ``friction`` is the scenario's multiple.

    Moments of inertia are moved to the frame's origin by Steiner's theorem. Oracle: MuJoCo's inverse dynamics,
    test_regressor.
    """
    found = np.empty((N_JOINTS, PER_LINK))
    for i in range(N_JOINTS):
        m, c = MASS_KG[i], COM_M[i]
        about_origin = np.diag(INERTIA_KG_M2[i]) + m * (c @ c * np.eye(3) - np.outer(c, c))
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = about_origin
        found[i, :N_OF_LINK] = [m, *(m * c), xx, yy, zz, xy, xz, yz]
        found[i, N_OF_LINK:] = [MOTOR_INERTIA[i], friction * VISCOUS[i], friction * COULOMB[i]]
    return found.ravel()


def pseudo_inertia(link: Array) -> Array:
    """Return the pseudo-inertia (4, 4) of a link's parameters (10,): a body of positive mass density has it positive.

    Wensing, Kim and Slotine, "Linear matrix inequalities for physically consistent inertial parameter
    identification", RA-L 3(1), 2018, equation 6. Oracle: sums over point masses, test_parameters.
    """
    m, mx, my, mz, xx, yy, zz, xy, xz, yz = link
    second = np.array(
        [[(yy + zz - xx) / 2, -xy, -xz], [-xy, (xx + zz - yy) / 2, -yz], [-xz, -yz, (xx + yy - zz) / 2]]
    )
    first = np.array([[mx], [my], [mz]])
    return np.block([[second, first], [first.T, np.array([[m]])]])
