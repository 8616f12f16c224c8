"""Motion of a set point between two ticks: towards its target or to a stop, as far as speed and acceleration allow.

A movement has two parts. The *carried* step goes on from tick to tick: its length is a speed, its change an
acceleration. A *correction* is spent once, at once, and leaves nothing behind that would have to be braked. Only the
carried step decides how far the set point still moves when its target stays, or when it is stopped:
at most v^2 / (2 a). One law serves places in m, rotation vectors in rad and the angle of a gripper.
"""

from math import dist, sqrt
from typing import Final, NamedTuple

from tis.common.vector import ZERO, Vector, minus, plus, scaled
from tis.patient_side.rotations import Quaternion, after_turn, is_orientation, turn_to

Place = Vector

STILL: Final[Vector] = ZERO
_ROUNDING: Final = 1e-12


class Pace(NamedTuple):
    """Bounds of a tick: length of the carried step, and its change from the last one, both in m or rad.

    ``change`` bounds how the step grows, ``brake``, at least as large, how what leads astray is given up.
    """

    step: float
    change: float
    brake: float


WINDOW_NS: Final = 33_000_000
"""Time over which speed and corrections are limited in tracking: at 1 kHz a filter's correction on a late sample is a
step of millimetres in one tick, and no movement at metres a second."""

NO_CORRECTION: Final = 0.0


class Motion(NamedTuple):
    """Motion of a set point after a tick; ``spent`` are the instants and lengths of its latest corrections."""

    carried: Vector = STILL
    has_met: bool = False
    spent: tuple[tuple[int, float], ...] = ()


AT_REST: Final = Motion()


class Moved(NamedTuple):
    """Movement of a tick; ``meets``: it ends on the target, bit for bit."""

    by: Vector
    meets: bool
    motion: Motion


def follow(way: Vector, motion: Motion, pace: Pace, most_corrected: float, t_ns: int) -> Moved:
    """Return the movement towards a target, which it meets if the bounds allow it.

    With a target that stays, the set point never leaves the segment between place and target by more than
    v^2 / (2 a), where v is the carried speed and a the acceleration, both as steps: l^2 / (2 change).

    Parameters
    ----------
    way
        From the place to the target, in m or rad.
    motion
        Motion of the set point after the last tick.
    pace
        Bounds of this tick.
    most_corrected
        Sum of the lengths of all corrections within `WINDOW_NS`, in m or rad.
    t_ns
        Instant of the tick in run time.

    Notes
    -----
    Oracles: test_set_point, by hypothesis, by a search for the worst target and against the time-optimal way.
    """
    (carried, has_met, spent), (most_carried, change, _), length = motion, pace, dist(way, STILL)
    if spent:
        spent = _recent(spent, t_ns)
    # The carried step that comes nearest to the target, and the correction that is missing then.
    fits = length <= most_carried and dist(way, carried) <= change
    if fits and has_met:  # as nearly always: nothing is to be corrected or kept back
        return Moved(way, True, Motion(way, True, spent))
    left = most_corrected - sum(amount for _, amount in spent)
    towards = way if fits else _shortened(_turned_towards(carried, way, change), most_carried)
    correction = 0.0 if fits else dist(way, towards)
    # A set point that comes from afar keeps back what brings it to rest at the target.
    kept_back = 0.0 if has_met else run_out(dist(towards, STILL), change)
    if correction + kept_back <= left or correction == kept_back == 0.0:
        return Moved(way, True, Motion(towards, True, spent if fits else (*spent, (t_ns, correction))))
    step = _carry(way, length, carried, pace)
    return Moved(step, False, Motion(step, False, spent))


def brake(motion: Motion, change: float) -> Moved:
    """Return the movement of a set point that has no target and comes to rest, slower by ``change`` each tick."""
    step = _turned_towards(motion.carried, STILL, change)
    return Moved(step, False, Motion(step, False, motion.spent))


def run_out(step: float, change: float) -> float:
    """Return the way of a set point that is braked after a carried ``step``: at most v^2 / (2 a)."""
    n = int(step / change)
    return n * step - change * n * (n + 1) / 2.0


def within(place: Place, centre: Place, radius_m: float) -> Place:
    """Return the place, or the nearest one of the sphere about ``centre``; no two places move apart by it."""
    distance_m = dist(place, centre)
    if distance_m <= radius_m * (1.0 + _ROUNDING):  # a place on the sphere stays as it is, bit for bit
        return place
    return plus(centre, scaled(minus(place, centre), radius_m / distance_m))


def _carry(way: Vector, length: float, carried: Vector, pace: Pace) -> Vector:
    """Return the next carried step. What does not lead to the target is given up first, then the step grows.

    So the distance from the segment plus what the carried step needs to end never grows, which is the bound above.
    """
    share, most = 0.0, 0.0
    if length > 0.0:
        most = min(pace.step, _longest_step(length, pace.change))
        along = (carried[0] * way[0] + carried[1] * way[1] + carried[2] * way[2]) / length
        share = min(max(along, 0.0), most) / length
    leading = scaled(way, share)
    astray = minus(carried, leading)
    n_astray = dist(astray, STILL)
    if n_astray > pace.brake:
        return plus(leading, scaled(astray, 1.0 - pace.brake / n_astray))
    if length == 0.0:
        return STILL
    return scaled(way, min(share * length + min(pace.brake - n_astray, pace.change), most) / length)


def _longest_step(distance: float, change: float) -> float:
    """Return the longest step s with s + (s - change) + (s - 2 change) + ... at most ``distance``."""
    n = int((sqrt(1.0 + 8.0 * distance / change) - 1.0) / 2.0)
    return (distance + change * n * (n + 1) / 2.0) / (n + 1)


def _turned_towards(step: Vector, wanted: Vector, change: float) -> Vector:
    """Return ``wanted``, or the step that differs by ``change`` from the last one in its direction."""
    difference = dist(step, wanted)
    return wanted if difference <= change else plus(step, scaled(minus(wanted, step), change / difference))


def _shortened(step: Vector, most: float) -> Vector:
    length = dist(step, STILL)
    return step if length <= most else scaled(step, most / length)


def _recent(spent: tuple[tuple[int, float], ...], t_ns: int) -> tuple[tuple[int, float], ...]:
    """Return the corrections of the last window, without this tick's."""
    if spent[0][0] > t_ns - WINDOW_NS:
        return spent
    return tuple(one for one in spent if one[0] > t_ns - WINDOW_NS)


# Orientation and gripper of a set point: they move by the law of its place, as angles.

_LEVEL: Quaternion = (0.0, 0.0, 0.0, 1.0)


class WristPose(NamedTuple):
    """Orientation x, y, z, w of any length but 0, and the gripper's angle in rad."""

    orientation: Quaternion
    gripper_rad: float


class WristPoint(NamedTuple):
    """Wrist of the set point after a tick, what it follows, and the motions of both parts.

    ``is_slow``: it follows at the pace of resuming until it has met its target.
    """

    at: WristPose
    target: WristPose
    turning: Motion = AT_REST
    gripping: Motion = AT_REST
    is_slow: bool = False


class WristLimits(NamedTuple):
    """Bounds of a tick in rad, of turning and of the gripper alike."""

    usual: Pace
    slow: Pace
    most_corrected: float


def begin(wrist: WristPose) -> WristPoint:
    """Return the first set point: the target itself, at rest."""
    at = WristPose(wrist.orientation if is_orientation(wrist.orientation) else _LEVEL, wrist.gripper_rad)
    return WristPoint(at, at, Motion(has_met=True), Motion(has_met=True))


def follow_wrist(point: WristPoint, target: WristPose, pace: Pace, most_corrected: float, t_ns: int) -> WristPoint:
    """Return the wrist on its way to ``target``; where the bounds allow it is the target's, bit for bit.

    A target of no orientation leaves the orientation where it is. Oracle: test_wrist_point, with SciPy's rotations.
    """
    (here, gripper_rad), there = point.at, target.orientation
    if not is_orientation(there):
        there = here
    turned = follow(turn_to(here, there), point.turning, pace, most_corrected, t_ns)
    way = (target.gripper_rad - gripper_rad, 0.0, 0.0)
    opened = follow(way, point.gripping, pace, most_corrected, t_ns)
    at = WristPose(
        there if turned.meets else after_turn(here, turned.by),
        target.gripper_rad if opened.meets else gripper_rad + opened.by[0],
    )
    is_slow = point.is_slow and not (turned.meets and opened.meets)
    return WristPoint(at, WristPose(there, target.gripper_rad), turned.motion, opened.motion, is_slow)


def brake_wrist(point: WristPoint, change: float) -> WristPoint:
    """Return the wrist that gives up its target and comes to rest."""
    turned, opened = brake(point.turning, change), brake(point.gripping, change)
    at = WristPose(_moved(point.at.orientation, turned), point.at.gripper_rad + opened.by[0])
    return WristPoint(at, at, turned.motion, opened.motion, point.is_slow)


def _moved(orientation: Quaternion, turned: Moved) -> Quaternion:
    """Return the orientation after a movement; without one it stays as it is, bit for bit."""
    return after_turn(orientation, turned.by) if any(turned.by) else orientation
