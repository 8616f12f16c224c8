"""Mouse and gamepad as operators' devices: what they do to a handle, whose pose is the message of a device."""

from dataclasses import dataclass, replace
from math import copysign
from typing import Final, Literal, NamedTuple

from tis.common.device import DevicePose
from tis.common.messages import Vector3
from tis.common.units import NS_PER_S

OPEN_RAD: Final = 0.8
"""Angle of the open gripper, in rad, as of the synthetic hand."""


@dataclass(frozen=True)
class Handle:
    """A handle: position in m (x to the right, y up, z towards the operator), gripper in rad, clutch."""

    x_m: float = 0.0
    y_m: float = 0.0
    z_m: float = 0.0
    gripper_rad: float = OPEN_RAD
    clutch: bool = False

    def pose(self, stamp_ns: int) -> DevicePose:
        """Return its message at ``stamp_ns`` of the device's own clock."""
        position_m = Vector3(x=self.x_m, y=self.y_m, z=self.z_m)
        return DevicePose(stamp_ns=stamp_ns, position_m=position_m, gripper_rad=self.gripper_rad, clutch=self.clutch)


M_PER_PX: Final = 1e-4
"""A hand's width of the screen, 800 pixels, is 80 mm of the master."""

M_PER_STEP: Final = 2e-3

Button = Literal["left", "right"]


class Moved(NamedTuple):
    """The mouse moved by pixels, x to the right and y down, as windows count."""

    x_px: float
    y_px: float


class Turned(NamedTuple):
    """The wheel turned by steps, positive away from the operator."""

    steps: float


class Pressed(NamedTuple):
    """A button went down or up: the left one closes the gripper, the right one is the clutch."""

    button: Button
    is_down: bool


MouseEvent = Moved | Turned | Pressed


def moved_by_mouse(handle: Handle, event: MouseEvent) -> Handle:
    """Return the handle after an event. Oracle: events with literal results, test_devices."""
    if isinstance(event, Moved):
        return replace(handle, x_m=handle.x_m + M_PER_PX * event.x_px, y_m=handle.y_m - M_PER_PX * event.y_px)
    if isinstance(event, Turned):
        return replace(handle, z_m=handle.z_m - M_PER_STEP * event.steps)
    if event.button == "left":
        return replace(handle, gripper_rad=0.0 if event.is_down else OPEN_RAD)
    return replace(handle, clutch=event.is_down)


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

    Oracle: literal values, test_devices.
    """
    size = abs(value)
    if not size > DEAD_ZONE:  # NaN, too
        return 0.0
    return copysign(min((size - DEAD_ZONE) / (1.0 - DEAD_ZONE), 1.0), value)


def moved_by_sticks(handle: Handle, sticks: Sticks, dt_ns: int) -> Handle:
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
