"""Payloads on the wire: JSON of these models. Their JSON Schemas go into the logs, in SI units throughout.

Sequence number and send time are not payload; they travel in the attachment (`common.header`).
"""

from itertools import pairwise
from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

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


class SampledPose(Pose):
    """A pose of a sampled stream and, where the scenario asks for it, those before it, for whoever missed them.

    ``history`` is ordered by sample instant, which lies before the pose's own. Without one nothing of it is on
    the wire: the bytes are a `Pose`'s.
    """

    history: tuple[Pose, ...] = Field((), description="Poses sampled before this one, the oldest first.")

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.history:
            instants = [*(pose.sample_ns for pose in self.history), self.sample_ns]
            if instants[0] < 0 or any(later <= sooner for sooner, later in pairwise(instants)):
                raise ValueError("history must be ordered by sample instant, and before the pose's own")
        return self

    def payload(self) -> bytes:
        """Return the bytes that fly."""
        return self.model_dump_json(exclude=None if self.history else {"history"}).encode()


class FeedbackPose(Pose):
    """A pose from the patient's side, with the command it answers: the surgeon measures the round trip by it."""

    tick: int = Field(ge=0)
    command_sample_ns: int | None


def position_m(pose: Pose) -> tuple[float, float, float]:
    """Return the pose's position as a tuple (x, y, z) in metres."""
    p = pose.position_m
    return (p.x, p.y, p.z)
