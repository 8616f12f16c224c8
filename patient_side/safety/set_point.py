"""Motion of a set point between two ticks: towards a target or to a stop, within a speed and an acceleration."""

from math import dist, sqrt
from typing import Final, NamedTuple

Place = tuple[float, float, float]

STILL: Final[Place] = (0.0, 0.0, 0.0)
_ROUNDING: Final = 1e-12


class Bounds(NamedTuple):
    """Bounds of one tick: of its step, in m, and of the step's change from the last one, in m."""

    step_m: float
    change_m: float


def follow(place: Place, last_step: Place, target: Place, bounds: Bounds) -> Place:
    """Return the next place on the way to ``target``.

    It is the target itself, bit for bit, where step and change of step stay within the bounds. Otherwise the set
    point goes straight towards it, no faster than it can brake in front of it. A step that was longer than the bound
    shortens by the allowed change. Oracle: test_set_point, by hypothesis and against the time-optimal way.

    Parameters
    ----------
    place, target
        Positions (3,) in m.
    last_step
        The last movement, place minus the place before it, in m.
    bounds
        Bounds of this tick.
    """
    way = minus(target, place)
    distance_m = dist(place, target)
    if distance_m <= bounds.step_m and dist(way, last_step) <= bounds.change_m:
        return target
    # The longest step from which the set point still comes to rest at the target: v^2 = 2 a d in steps of a tick.
    length_m = min(bounds.step_m, sqrt(2.0 * bounds.change_m * distance_m), distance_m)
    wanted = _scaled(way, length_m / distance_m) if distance_m > 0.0 else STILL
    return _plus(place, _bounded(_towards(last_step, wanted, bounds.change_m), last_step, bounds))


def brake(place: Place, last_step: Place, bounds: Bounds) -> Place:
    """Return the next place of a set point that comes to a stop as fast as the bounds allow."""
    return _plus(place, _towards(last_step, STILL, bounds.change_m))


def within(place: Place, centre: Place, radius_m: float) -> Place:
    """Return the place, or the nearest one of the sphere about ``centre``; no two places move apart by it."""
    distance_m = dist(place, centre)
    if distance_m <= radius_m * (1.0 + _ROUNDING):  # a place on the sphere stays as it is, bit for bit
        return place
    return _plus(centre, _scaled(minus(place, centre), radius_m / distance_m))


def _towards(step: Place, wanted: Place, change_m: float) -> Place:
    """Return ``wanted``, or the step that differs by ``change_m`` from the last one in its direction."""
    change = dist(step, wanted)
    return wanted if change <= change_m else _plus(step, _scaled(minus(wanted, step), change_m / change))


def _bounded(step: Place, last_step: Place, bounds: Bounds) -> Place:
    """Return a step no longer than the bound, or than the last step less the allowed change."""
    length_m, last_m = dist(step, STILL), dist(last_step, STILL)
    most_m = max(bounds.step_m, last_m - bounds.change_m)
    return step if length_m <= most_m else _scaled(step, most_m / length_m)


def _plus(a: Place, b: Place) -> Place:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def minus(a: Place, b: Place) -> Place:
    """Return the step from ``b`` to ``a``."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _scaled(a: Place, factor: float) -> Place:
    return a[0] * factor, a[1] * factor, a[2] * factor
