"""The mouse as a device: it moves the handle in the plane of the screen, its wheel in depth."""

from dataclasses import replace
from typing import Final, Literal, NamedTuple

from tis.surgeon_side.devices.handle import OPEN_RAD, Handle

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


def after(handle: Handle, event: MouseEvent) -> Handle:
    """Return the handle after an event. Oracle: events with literal results, test_mouse."""
    if isinstance(event, Moved):
        return replace(handle, x_m=handle.x_m + M_PER_PX * event.x_px, y_m=handle.y_m - M_PER_PX * event.y_px)
    if isinstance(event, Turned):
        return replace(handle, z_m=handle.z_m - M_PER_STEP * event.steps)
    if event.button == "left":
        return replace(handle, gripper_rad=0.0 if event.is_down else OPEN_RAD)
    return replace(handle, clutch=event.is_down)
