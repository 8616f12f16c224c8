"""Payloads on the wire: JSON of these models. Their JSON Schemas go into the logs, in SI units throughout.

Sequence number and send time are not payload; they travel in the attachment (`common.header`).
"""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Finite = Annotated[float, Field(allow_inf_nan=False)]


class Message(BaseModel):
    """Base of every payload: immutable, no unknown fields, finite numbers only."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Vector3(Message):
    """A position, in metres."""

    x: Finite
    y: Finite
    z: Finite


class Quaternion(Message):
    """A unit quaternion, scalar last."""

    x: Finite
    y: Finite
    z: Finite
    w: Finite


class Pose(Message):
    """A Cartesian pose of a tool tip, as CRTK's ``measured_cp`` and ``setpoint_cp`` carry it.

    ``sample_ns`` is its sample instant in run time: when it was taken, or for which instant it was estimated.
    """

    sample_ns: int
    position_m: Vector3
    orientation: Quaternion
    gripper_rad: Finite


class FeedbackPose(Pose):
    """A pose from the patient's side, with the command it answers: the surgeon measures the round trip by it."""

    tick: int = Field(ge=0)
    command_sample_ns: int | None


def position_m(pose: Pose) -> tuple[float, float, float]:
    """Return the pose's position as a tuple (x, y, z) in metres."""
    p = pose.position_m
    return (p.x, p.y, p.z)
