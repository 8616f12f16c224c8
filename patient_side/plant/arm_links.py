"""Masses, inertias, friction and motors of the simulated arm's links.

They are assumptions of the right size, not those of one arm: aluminium links of a few hundred grams, a tool of 10 g,
a carriage of half a kilogram, torques as the research kit's amplifiers give them. The da Vinci arm's parallelogram,
counterweight and springs are left out: the arm is a chain of seven links, and its motors carry its weight. Published
identifications (Wang et al., "A convex optimization-based dynamic model identification package for the da Vinci
Research Kit", RA-L 4(4), 2019; Fontanelli et al., IROS 2017) have such orders of size.
"""

from typing import Final

import numpy as np

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
