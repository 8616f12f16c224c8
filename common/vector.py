"""Vectors of three plain numbers: on so few of them Python is faster than numpy."""

from math import sqrt
from typing import Final

from tis.common.messages import Vector3

Vector = tuple[float, float, float]
ZERO: Final[Vector] = (0.0, 0.0, 0.0)


def plus(a: Vector, b: Vector) -> Vector:
    """Return the sum."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def minus(a: Vector, b: Vector) -> Vector:
    """Return the way from ``b`` to ``a``."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def scaled(a: Vector, factor: float) -> Vector:
    """Return the vector times a factor."""
    return a[0] * factor, a[1] * factor, a[2] * factor


def dot(a: Vector, b: Vector) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def size(a: Vector) -> float:
    """Return the length."""
    return sqrt(dot(a, a))


def limited(a: Vector, most: float) -> Vector:
    """Return the vector, shortened to ``most`` if it is longer."""
    length = size(a)
    return a if length <= most else scaled(a, most / length)


def of(message: Vector3) -> Vector:
    """Return a message's vector."""
    return message.x, message.y, message.z


def as_message(a: Vector) -> Vector3:
    """Return the vector as a message's."""
    return Vector3(x=a[0], y=a[1], z=a[2])
