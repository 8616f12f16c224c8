"""Orientation and gripper of an arm as messages and records carry them.

The interface of an orientation method: a pure function of the arrived samples and an instant.
"""

from math import sqrt
from typing import Final, NamedTuple, Protocol

from tis.common.channels import Hand
from tis.common.messages import MAX_SIZE, Pose, Quaternion, Vector3
from tis.common.records import OrientationNote
from tis.common.scenario.patient import OrientationMethod
from tis.patient_side.linear_system import Array
from tis.patient_side.playout import SourceBuffer
from tis.patient_side.rotations import Quaternion as Components
from tis.patient_side.rotations import is_orientation


class WristEstimate(NamedTuple):
    """Orientation and gripper of the arm at an instant; None where there is no estimate, or no covariance.

    ``orientation`` (4,) is a unit quaternion x, y, z, w. ``covariance_rad2`` (3, 3) is that of the rotation vector
    from the estimate to the truth, in the body frame of the estimate; ``gripper_variance_rad2`` that of the gripper.
    """

    orientation: Array | None
    covariance_rad2: Array | None = None
    gripper_rad: float | None = None
    gripper_variance_rad2: float | None = None


NOTHING = WristEstimate(None)


class WristMethod(Protocol):
    """A method without a state: it reads the arm's arrived samples only, which makes it causal."""

    @property
    def name(self) -> OrientationMethod:
        """Return the name that scenarios use."""
        ...

    def estimate(self, arm: SourceBuffer, age_samples: float) -> WristEstimate:
        """Return the estimate ``age_samples`` >= 0 sample periods, fractions included, after the newest sample."""
        ...


_ROUNDED: Final = 1e-12
"""Variance in rad^2 that rounding may take away."""
LEVEL: Final = Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)


class Wrist(NamedTuple):
    """Orientation of a tool tip, and opening angle of its gripper in rad."""

    orientation: Quaternion
    gripper_rad: float


class Stated(NamedTuple):
    """An estimate and its standard deviations in rad, those of the orientation about the axes of its frame."""

    orientation: Quaternion | None
    std_rad: Vector3 | None
    gripper_rad: float | None
    gripper_std_rad: float | None


def quaternion(orientation: Components) -> Quaternion:
    """Return an orientation as a message's quaternion."""
    x, y, z, w = orientation
    return Quaternion(x=x, y=y, z=z, w=w)


def stated_turn(orientation: Array | None) -> Quaternion | None:
    """Return an orientation (4,) as a message's quaternion; None where it is none, or no message can state it."""
    if orientation is None:
        return None
    parts: Components = tuple(orientation.tolist())
    return quaternion(parts) if is_orientation(parts) and max(map(abs, parts)) <= MAX_SIZE else None


def stated(estimate: WristEstimate) -> tuple[Stated, bool]:
    """Return an estimate as records state it, and whether it is whole: what no message can state is left out."""
    orientation, covariance, gripper_rad, variance = estimate
    turn = stated_turn(orientation)
    is_whole = (turn is None) == (orientation is None)
    std_rad = gripper_std_rad = None
    if covariance is not None and turn is not None:
        x, y, z = (_deviation(part) for part in covariance.diagonal().tolist())
        std_rad = None if x is None or y is None or z is None else Vector3(x=x, y=y, z=z)
        is_whole = is_whole and std_rad is not None
    if gripper_rad is not None and not abs(gripper_rad) <= MAX_SIZE:
        gripper_rad, is_whole = None, False
    if variance is not None and gripper_rad is not None:
        gripper_std_rad = _deviation(variance)
        is_whole = is_whole and gripper_std_rad is not None
    return Stated(turn, std_rad, gripper_rad, gripper_std_rad), is_whole


def _deviation(variance: float) -> float | None:
    """Return the deviation that a record can state; None where the variance is none. Rounding leaves some below 0."""
    return sqrt(max(variance, 0.0)) if -_ROUNDED <= variance <= MAX_SIZE**2 else None


def answered(estimate: Stated, newest: Pose | None) -> Wrist:
    """Return what an answer carries: the estimate, the ``newest`` sample's without one, level before any sample."""
    orientation, gripper_rad = estimate.orientation, estimate.gripper_rad
    if orientation is None:
        orientation = LEVEL if newest is None else newest.orientation
    if gripper_rad is None:
        gripper_rad = 0.0 if newest is None else newest.gripper_rad
    return Wrist(orientation, gripper_rad)


def orientation_note(tick: int, t_ns: int, hand: Hand, method: str, found: Stated, step_ns: int) -> OrientationNote:
    """Return the record of one method at one tick."""
    return OrientationNote(
        tick=tick,
        t_ns=t_ns,
        hand=hand,
        method=method,
        orientation=found.orientation,
        std_rad=found.std_rad,
        gripper_rad=found.gripper_rad,
        gripper_std_rad=found.gripper_std_rad,
        step_ns=step_ns,
    )
