"""One hand at the patient: its channels, its arrived samples, its estimators and its arm."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import sqrt
from typing import Any, NamedTuple

from tis.common.channels import HandChannels
from tis.common.messages import MAX_SIZE, Pose, SafetyMode, Vector3
from tis.common.records import ESTIMATES, ORIENTATIONS
from tis.common.scenario.estimator_names import plain_name
from tis.patient_side.estimators.protocol import Estimator
from tis.patient_side.linear_system import Array
from tis.patient_side.orientation.wrist import NOTHING, Stated, Wrist, WristEstimate, WristMethod
from tis.patient_side.plant.protocol import Plant, PlantOutput
from tis.patient_side.playout import Playout
from tis.patient_side.safety.gated_intake import Evidence
from tis.patient_side.safety.safety_state import SafetyFilter, SafetyState
from tis.patient_side.safety.set_point import Place
from tis.patient_side.touch import ArmTouch


class Fresh(NamedTuple):
    """The newest sample of a hand: its packet's key and sequence number, and its instant."""

    key: str
    seq: int
    sample_ns: int


class Driven(NamedTuple):
    """A hand's set point at a tick; without a place its arm keeps the one before."""

    place: Place | None
    wrist: Wrist


class Begun(NamedTuple):
    """The published part of a hand's tick: the active estimates, their durations and number, and the set point.

    ``mode_before`` is the safety state before the tick.
    """

    where_m: Vector3 | None
    std_m: Vector3 | None
    step_ns: int
    wrist: Stated
    wrist_step_ns: int
    number: int | None
    driven: Driven
    mode_before: SafetyMode


def vector(values: Array) -> Vector3:
    """Return a position (3,) as a message's vector."""
    x, y, z = values.tolist()
    return Vector3(x=x, y=y, z=z)


def finite(values: Array | None) -> Vector3 | None:
    """Return a position (3,) as a message's vector; None where it is missing, not finite or above `MAX_SIZE`."""
    place = bounded(values)
    if place is None:
        return None
    x, y, z = place
    return Vector3(x=x, y=y, z=z)


def bounded(values: Array | None) -> tuple[float, float, float] | None:
    """Return a position (3,) as numbers; None where it is missing, not finite or above `MAX_SIZE`."""
    if values is None:
        return None
    x, y, z = values.tolist()
    return (x, y, z) if _is_bounded(x, y, z, MAX_SIZE) else None


def std_m(position_m: Vector3 | None, covariance_m2: Array | None) -> Vector3 | None:
    """Return an estimate's standard deviation per axis; None where it has no position or no valid covariance."""
    if position_m is None or covariance_m2 is None:
        return None
    x, y, z = covariance_m2.diagonal().tolist()
    if not (x >= 0.0 and y >= 0.0 and z >= 0.0 and _is_bounded(x, y, z, MAX_SIZE**2)):
        return None
    return Vector3(x=sqrt(x), y=sqrt(y), z=sqrt(z))


def _is_bounded(x: float, y: float, z: float, most: float) -> bool:
    """Return whether all are numbers of size ``most`` or less; NaN is not."""
    return -most <= x <= most and -most <= y <= most and -most <= z <= most


@dataclass
class PatientHand:
    """One hand: its channels, its arrived samples, its estimators (the first is the active one) and its arm.

    ``freshest`` is the newest sample of either stream, ``pose`` the newest of the arm. ``prompt_ns`` is the instant
    of an arrival to be answered before the next tick, ``topics`` are the log topics of the estimates. Without
    ``safety`` the active estimate drives the arm as it is. ``methods`` estimate orientation and gripper, the first is
    the active one; without any the answers carry those of ``pose``. ``conflicts`` are contradictions between the
    samples of a stream, ``holds_on_conflict``: they hold the arm. ``foreign`` are set points that others sent,
    ``n_not_stated`` counts what was computed for it that no message can state.
    ``moved`` is where the plant's arm is since the last tick, ``touch`` what it feels and is coupled by.
    """

    channels: HandChannels
    playout: Playout
    estimators: Sequence[Estimator]
    plant: Plant | None
    safety: SafetyFilter | None = None
    methods: Sequence[WristMethod] = ()
    states: list[Any] = field(init=False)
    topics: tuple[str, ...] = field(init=False)
    method_topics: tuple[str, ...] = field(init=False)
    plant_state: Any = field(init=False)
    freshest: Fresh | None = None
    used_sample_ns: int = -1
    answered_sample_ns: int = -1
    prompt_ns: int | None = None
    n_answers: int = 0
    safety_state: SafetyState = field(default_factory=SafetyState)
    pose: Pose | None = None
    conflicts: Evidence = field(default_factory=Evidence)
    holds_on_conflict: bool = False
    foreign: Evidence = field(default_factory=Evidence)
    n_not_stated: int = 0
    moved: PlantOutput | None = None
    touch: ArmTouch | None = None

    def __post_init__(self) -> None:
        self.states = [estimator.initial() for estimator in self.estimators]
        self.topics = tuple(f"{ESTIMATES}/{plain_name(estimator.name)}" for estimator in self.estimators)
        self.method_topics = tuple(f"{ORIENTATIONS}/{method.name}" for method in self.methods)
        self.plant_state = None if self.plant is None else self.plant.initial()

    def is_in_conflict(self, t_ns: int) -> bool:
        """Tell whether contradictions between its samples hold the arm at a tick."""
        return self.holds_on_conflict and self.conflicts.holds(t_ns)

    def wrist_at(self, i: int, t_ns: int) -> WristEstimate:
        """Return the estimate of orientation method ``i`` for the instant ``t_ns``; nothing without such a method."""
        if i >= len(self.methods):
            return NOTHING
        arm = self.playout.arm
        return self.methods[i].estimate(arm, max(self.playout.age_samples(arm.newest, t_ns), 0.0))
