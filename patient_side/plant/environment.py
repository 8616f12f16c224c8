"""The environment of an arm: a wall or tissue behind a plane, and its force on the tool tip."""

from dataclasses import dataclass
from math import sqrt
from typing import Protocol

from tis.common.scenario.touch import Environment as EnvironmentPart
from tis.common.scenario.touch import TissueEnvironment
from tis.common.units import MM_PER_M
from tis.common.vector import ZERO, Vector, dot, minus, scaled, size


class Law(Protocol):
    """Force that presses back, in N, by depth in m and speed into the material in m/s."""

    def force_n(self, depth_m: float, speed_m_s: float) -> float:
        """Return the force, 0 or more; the depth is above 0."""


@dataclass(frozen=True)
class Wall:
    """A spring and a damper, which push and never pull."""

    stiffness_n_m: float
    damping_ns_m: float

    def force_n(self, depth_m: float, speed_m_s: float) -> float:
        """Return ``max(0, K d + B d')``."""
        return max(0.0, self.stiffness_n_m * depth_m + self.damping_ns_m * speed_m_s)


@dataclass(frozen=True)
class Tissue:
    """A half space that a round tip presses: Hertz's contact with the damping of Hunt and Crossley.

    ``F = k d^1.5 (1 + 1.5 c d')`` with ``k = 4/3 E / (1 - nu^2) sqrt(R)`` and ``E = 2 G (1 + nu)``. Oracles:
    published figures of liver and tumour, and the loss of a cycle by quadrature, test_environment.
    """

    k: float
    loss_s_m: float

    @classmethod
    def of(cls, part: TissueEnvironment) -> "Tissue":
        """Return the tissue of a scenario."""
        poisson = part.poisson_ratio
        young_pa = 2.0 * part.shear_modulus_kpa * 1000.0 * (1.0 + poisson)
        return cls(4.0 / 3.0 * young_pa / (1.0 - poisson**2) * sqrt(part.tip_radius_mm / MM_PER_M), part.loss_s_m)

    def force_n(self, depth_m: float, speed_m_s: float) -> float:
        """Return the force."""
        return max(0.0, self.k * depth_m * sqrt(depth_m) * (1.0 + 1.5 * self.loss_s_m * speed_m_s))


@dataclass(frozen=True)
class Environment:
    """Material behind a plane with a unit ``normal`` out of it; the plane lies at a place, or before the arm's first.

    A place is in m, in the frame of the arm's positions; ``distance_m`` is from the first set point to the plane.
    """

    law: Law
    normal: Vector
    place_m: Vector | None
    distance_m: float = 0.0

    def surface_m(self, first_m: Vector) -> Vector:
        """Return a point of the plane, by the arm's first set point."""
        return minus(first_m, scaled(self.normal, self.distance_m)) if self.place_m is None else self.place_m

    def force(self, surface_m: Vector, position_m: Vector, velocity_m_s: Vector) -> Vector:
        """Return the force (N) on the tool tip."""
        depth_m = dot(minus(surface_m, position_m), self.normal)
        if depth_m <= 0.0:
            return ZERO
        return scaled(self.normal, self.law.force_n(depth_m, -dot(velocity_m_s, self.normal)))


def environment_of(part: EnvironmentPart) -> Environment:
    """Return what the arms of a scenario touch."""
    law: Law = Tissue.of(part) if part.kind == "tissue" else Wall(part.stiffness_n_m, part.damping_ns_m)
    place = part.position_mm
    x, y, z = place or ZERO
    place_m = None if place is None else (x / MM_PER_M, y / MM_PER_M, z / MM_PER_M)
    normal = scaled(part.normal, 1.0 / size(part.normal))
    return Environment(law, normal, place_m, part.distance_m)
