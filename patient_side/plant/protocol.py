"""An arm at the patient: what drives it, where it is, and how it moves from tick to tick."""

from typing import Any, NamedTuple, Protocol

from tis.common.vector import Vector
from tis.patient_side.linear_system import Array


class Reference(NamedTuple):
    """A set point: position (3,) in m, orientation (4,) as a unit quaternion x, y, z, w, and gripper in rad.

    ``orientation`` is None while no sample has told it.
    """

    position_m: Array
    orientation: Array | None = None
    gripper_rad: float = 0.0


class PlantOutput(NamedTuple):
    """The arm's position (3,) in m, and its position as measured by its sensors.

    ``orientation`` (4,) is a unit quaternion x, y, z, w; None where the arm takes that of its set point, as it does
    with the gripper, in rad. ``is_clamped``: the set point in force lies outside what the joints reach. ``force_n``
    is the force of what it touches on the tool tip, None where there is nothing to touch.
    """

    position_m: Array
    measured_m: Array
    orientation: Array | None = None
    gripper_rad: float | None = None
    is_clamped: bool = False
    force_n: Vector | None = None


class Plant(Protocol):
    """Frozen parameters, an initial state, and a pure step from tick to tick."""

    def initial(self) -> Any:
        """Return the state before the first tick."""
        ...

    def step(self, state: Any, reference: Reference | None, tick: int, now_ns: int) -> tuple[Any, PlantOutput | None]:
        """Return the new state and the arm at ``now_ns``; None before the first reference of an arm that needs one.

        ``reference`` holds from now until the next tick; None keeps the last one.
        """
        ...
