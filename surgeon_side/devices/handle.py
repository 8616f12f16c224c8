"""The handle that mouse or gamepad moves: its place, gripper and clutch, as the message of a device."""

from dataclasses import dataclass
from typing import Final

from tis.common.devices.pose import DevicePose
from tis.common.messages import Vector3

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
