"""Region within the unit box that is made of simplices with the best corner in common.

In the plane they are triangles between neighbouring rays; on a single axis the region is an interval.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations
from math import factorial, prod
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.deploy.admissible.rays import Place

Array = NDArray[np.float64]
Simplex = tuple[Place, ...]
"""Directions of its rays, as many as there are axes."""

_ROUNDING: Final = 1e-9


class Vertex(NamedTuple):
    """Where a ray leaves the region: its direction, and its ``radius``, a distance along it in [0, 1]."""

    direction: Place
    radius: float


def whole_box(n_axes: int) -> list[Simplex]:
    """Return the simplices of the whole unit box by Kuhn's triangulation, one for each order of the axes."""
    found = []
    for order in permutations(range(n_axes)):
        corner, simplex = [0.0] * n_axes, []
        for axis in order:
            corner[axis] = 1.0
            simplex.append(tuple(corner))
        found.append(tuple(simplex))
    return found


@dataclass(frozen=True)
class Region:
    """Simplices from the corner ``start``, given by the vertices opposite to it; none: the region is empty."""

    start: Place
    simplices: tuple[tuple[Vertex, ...], ...]

    @property
    def share(self) -> float:
        """Return the region's share of the box. Oracle: known shapes, test_border."""
        sizes = (
            abs(float(np.linalg.det(np.array([vertex.direction for vertex in simplex]))))
            * prod(vertex.radius for vertex in simplex)
            for simplex in self.simplices
        )
        return sum(sizes) / factorial(len(self.start))

    def contains(self, place: Sequence[float]) -> bool:
        """Tell whether a place lies in the region, its border included."""
        away = np.abs(np.array(place) - np.array(self.start))
        for cone, radii in self._cones:
            parts = cone @ away
            if (parts >= -_ROUNDING).all():
                parts = np.where(parts < _ROUNDING, 0.0, parts)
                with np.errstate(divide="ignore", invalid="ignore"):
                    return bool(np.where(parts > 0, parts / radii, 0.0).sum() <= 1 + _ROUNDING)
        return False

    @cached_property
    def _cones(self) -> list[tuple[Array, Array]]:
        """Return of each simplex the map from a place to its parts along the rays, and the radii."""
        return [
            (
                np.linalg.inv(np.array([vertex.direction for vertex in simplex]).T),
                np.array([vertex.radius for vertex in simplex]),
            )
            for simplex in self.simplices
        ]

    @property
    def border(self) -> list[Place]:
        """Return the border points, those of the plane in the order of their angles."""
        vertices = {vertex.direction: vertex for simplex in self.simplices for vertex in simplex}
        ordered = sorted(vertices.values(), key=lambda vertex: (-vertex.direction[0], *vertex.direction[1:]))
        return [along(self.start, vertex.direction, vertex.radius) for vertex in ordered]


def along(start: Place, direction: Place, distance: float) -> Place:
    """Return the place at a distance from a corner of the box, along a direction into it."""
    # Without rounding beyond the box.
    pairs = zip(start, direction, strict=True)
    return tuple(distance * step if corner == 0.0 else 1.0 - distance * step for corner, step in pairs)
