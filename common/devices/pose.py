"""The message of an operator's device: its pose, on a key of the surgeon's network, without a header of ours."""

from typing import Annotated, Final

from pydantic import FailFast, Field

from tis.common.messages import Message, Quaternion, Vector3

MAX_DEVICE_BYTES: Final = 2048
"""Largest payload of a device; a pose has some 300 bytes."""

MAX_BUTTONS: Final = 32

_MAX_STAMP: Final = 1 << 62  # 146 years in ns, within 64 bits

Angle = Annotated[float, Field(allow_inf_nan=False, ge=-6.3, le=6.3)]
"""An angle in rad, at most a turn."""


class DevicePose(Message):
    """One pose of an operator's device, in the device's own frame; only the position is required."""

    stamp_ns: int | None = Field(
        None,
        ge=-_MAX_STAMP,
        le=_MAX_STAMP,
        description="The device's own clock, in ns from any origin; null: none. Only its order is checked.",
    )
    position_m: Vector3 = Field(description="Position of the device's handle, in m.")
    orientation: Quaternion = Field(
        Quaternion(x=0.0, y=0.0, z=0.0, w=1.0),
        description="Orientation of the handle, a quaternion of any length but 0.",
    )
    gripper_rad: Angle = Field(0.0, description="Opening angle of the gripper, in rad.")
    clutch: bool = Field(
        False, strict=True, description="true: the operator moves the device to another place, the arm holds."
    )
    buttons: Annotated[tuple[bool, ...], FailFast()] = Field(
        (), max_length=MAX_BUTTONS, description="Further buttons of the device; the testbed uses none."
    )
