"""Region within the unit box that is made of simplices with the best corner in common.

In the plane they are triangles between neighbouring rays; on a single axis the region is an interval.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations
from math import exp, factorial, isfinite, log, prod
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.errors import Fault, InputError
from tis.deploy.compare.grid import Sweep, grid_faults
from tis.deploy.studies.admissible.criterion import COMMAND

Array = NDArray[np.float64]
Place = tuple[float, ...]
"""Point of the unit box, a share of each axis."""
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


MAX_AXES: Final = 4
_RANGE: Final = re.compile(r"(?P<first>[^:]+?)\.\.(?P<last>[^:]+?)(?P<log>:log)?")
_RULE: Final = "must read a.b=FIRST..LAST[:log], two numbers, the smaller one first"


@dataclass(frozen=True)
class Axis:
    """A field from ``first`` to ``last`` > ``first``; ``log``: by equal ratios; ``whole``: it takes integers only."""

    path: str
    first: float
    last: float
    log: bool = False
    whole: bool = False

    def value(self, share: float) -> float:
        """Return the field's value at a share of the axis in [0, 1]."""
        if share in (0.0, 1.0):
            return self.last if share else self.first
        if self.log:
            found = exp(log(self.first) + share * (log(self.last) - log(self.first)))
        else:
            found = self.first + share * (self.last - self.first)
        return float(round(found)) if self.whole else float(f"{found:.9g}")

    def share(self, value: float) -> float:
        """Return the share of the axis at a value, outside of [0, 1] beyond the ends."""
        if self.log:
            if value <= 0:
                return float("-inf")
            return (log(value) - log(self.first)) / (log(self.last) - log(self.first))
        return (value - self.first) / (self.last - self.first)

    def text(self, share: float) -> str:
        """Return the value as a setting takes it: without an exponent, which YAML would take for text."""
        value = self.value(share)
        return str(int(value)) if self.whole else np.format_float_positional(value, trim="-")


def parse_axis(text: str) -> Axis:
    """Return ``a.b=FIRST..LAST[:log]`` as an axis; raises `InputError`."""
    path, equals, span = text.partition("=")
    found = _RANGE.fullmatch(span.strip())
    if not equals or not all(path.split(".")) or found is None:
        raise InputError(Fault(COMMAND, "--over", _RULE, text))
    try:
        first, last = float(found["first"]), float(found["last"])
    except ValueError:
        raise InputError(Fault(COMMAND, "--over", _RULE, text)) from None
    if not (isfinite(first) and isfinite(last)) or first >= last:
        rule = "the range is empty or reversed" if first >= last else _RULE
        raise InputError(Fault(COMMAND, "--over", f"{rule}: the smaller number comes first", text))
    if found["log"] and first <= 0:
        raise InputError(Fault(COMMAND, "--over", "a geometric range needs numbers above 0", text))
    return Axis(path, first, last, log=found["log"] is not None)


def whole_fault(axis: Axis) -> Fault | None:
    """Return the fault of an axis of integers that ends between two of them."""
    if not axis.whole or (axis.first.is_integer() and axis.last.is_integer()):
        return None
    rule = "takes integers only, so the range must run between two of them"
    return Fault(COMMAND, "--over", rule, f"{axis.path}={axis.first:g}..{axis.last:g}")


def axis_faults(axes: tuple[Axis, ...]) -> list[Fault]:
    """Return what is wrong with a combination of axes."""
    if len(axes) > MAX_AXES:
        return [Fault(COMMAND, "--over", f"at most {MAX_AXES} fields can vary at once", len(axes))]
    if not axes:
        return [Fault(COMMAND, "--over", "is required: a.b=FIRST..LAST, the field that varies")]
    faults = grid_faults(tuple(Sweep(axis.path, ("",)) for axis in axes), zipped=True)
    return [Fault(COMMAND, "--over", fault.rule.replace("swept", "varied"), fault.got) for fault in faults]
