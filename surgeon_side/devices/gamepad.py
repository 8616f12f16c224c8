"""The gamepad as a device: its sticks are velocities of the handle, its trigger closes the gripper."""

from dataclasses import replace
from math import copysign
from typing import Final, NamedTuple

from tis.common.units import NS_PER_S
from tis.surgeon_side.devices.handle import OPEN_RAD, Handle

DEAD_ZONE: Final = 0.15
"""Share of a stick's way that moves nothing: worn sticks rest up to a tenth beside their middle."""

SPEED_M_S: Final = 0.15
"""Speed at a stick's end, in m/s: median speeds of recorded suturing are below."""

_MAX_STEP_NS: Final = NS_PER_S // 10


class Sticks(NamedTuple):
    """State of a gamepad: sticks from -1 to 1 (right and down positive), trigger 0 to 1, clutch button."""

    left_x: float
    left_y: float
    right_y: float
    trigger: float
    clutch: bool


def deflection(value: float) -> float:
    """Return a stick's deflection beyond the dead zone, continuous and -1 to 1; 0 for a value that is none.

    Oracle: literal values, test_gamepad.
    """
    size = abs(value)
    if not size > DEAD_ZONE:  # NaN, too
        return 0.0
    return copysign(min((size - DEAD_ZONE) / (1.0 - DEAD_ZONE), 1.0), value)


def after(handle: Handle, sticks: Sticks, dt_ns: int) -> Handle:
    """Return the handle after ``dt_ns`` in this state; after a pause of the program it moves for 0.1 s at most."""
    step_m = SPEED_M_S * min(max(dt_ns, 0), _MAX_STEP_NS) / NS_PER_S
    return replace(
        handle,
        x_m=handle.x_m + step_m * deflection(sticks.left_x),
        y_m=handle.y_m - step_m * deflection(sticks.left_y),
        z_m=handle.z_m + step_m * deflection(sticks.right_y),
        gripper_rad=OPEN_RAD * (1.0 - deflection(sticks.trigger)),
        clutch=sticks.clutch,
    )
