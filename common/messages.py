"""Payloads on the wire: JSON of these models, in SI units. Their JSON Schemas are part of the logs.

Sequence number and send time travel in the attachment (`tis.common.header`), outside the payload.
"""

from itertools import pairwise
from typing import Annotated, Final, Literal, Self

from pydantic import BaseModel, ConfigDict, FailFast, Field, model_validator

MAX_SIZE: Final = 1e9
"""Size of the largest number in a message. In metres it lies beyond the Moon; sums of its squares do not overflow."""

_MAX_STAMP: Final = 1 << 62
"""Size of the largest integer in a message, and of an instant in ns: 146 years. Differences of two fit 64 bits."""

MAX_HISTORY: Final = 256
"""Number of earlier poses in a message."""

Finite = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-MAX_SIZE, le=MAX_SIZE)]


class Message(BaseModel):
    """Base of every payload: immutable, no unknown fields, finite numbers up to `MAX_SIZE` only."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Vector3(Message):
    """A vector in Cartesian coordinates; the unit is that of the field."""

    x: Finite = Field(description="Component along x.")
    y: Finite = Field(description="Component along y.")
    z: Finite = Field(description="Component along z.")


class Quaternion(Message):
    """A unit quaternion, scalar last."""

    x: Finite = Field(description="Vector part, x.")
    y: Finite = Field(description="Vector part, y.")
    z: Finite = Field(description="Vector part, z.")
    w: Finite = Field(description="Scalar part.")


class Pose(Message):
    """A Cartesian pose of a tool tip, as in CRTK's ``measured_cp`` and ``setpoint_cp``."""

    sample_ns: int = Field(
        strict=True,
        ge=-_MAX_STAMP,
        le=_MAX_STAMP,
        description="Run time at which the pose was sampled, or that it is estimated for, in ns.",
    )
    position_m: Vector3 = Field(description="Position of the tool tip, in m.")
    orientation: Quaternion = Field(description="Orientation of the tool tip.")
    gripper_rad: Finite = Field(description="Opening angle of the gripper, in rad.")


class SampledPose(Pose):
    """A pose of a sampled stream and, where the scenario configures a history, the poses before it.

    Without a history the payload holds the fields of `Pose` only.
    """

    history: Annotated[tuple[Pose, ...], FailFast()] = Field(
        (), max_length=MAX_HISTORY, description="Poses sampled before this one, by ascending sample_ns."
    )

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.history:
            instants = [*(pose.sample_ns for pose in self.history), self.sample_ns]
            if instants[0] < 0 or any(later <= sooner for sooner, later in pairwise(instants)):
                raise ValueError("history must be ordered by sample instant, and before the pose's own")
        return self

    def payload(self) -> bytes:
        """Return the payload's bytes."""
        return self.model_dump_json(exclude=None if self.history else {"history"}).encode()


class FeedbackPose(Pose):
    """A pose from the patient's side, with the command that it answers, from which the round trip is measured."""

    tick: int = Field(strict=True, ge=0, le=_MAX_STAMP, description="Number of the patient's tick, from 0.")
    command_sample_ns: int | None = Field(
        strict=True,
        ge=-_MAX_STAMP,
        le=_MAX_STAMP,
        description="Sample instant of the newest command at that tick, in ns; null: none has arrived.",
    )


SafetyMode = Literal["tracking", "resuming", "hold", "slow_stop", "safe"]


class SetPoint(Pose):
    """The pose that drives the patient's arm, as in CRTK's ``servo_cp``: the active estimate within its limits."""

    hand: Literal["left", "right"] = Field(description="Hand whose arm is driven.")
    tick: int = Field(ge=0, description="Number of the patient's tick, from 0.")
    mode: SafetyMode = Field(description="Safety state: tracking, resuming, hold, slow_stop or safe.")
    age_ns: int | None = Field(description="Age of the newest sample, in ns; null: none has arrived.")


class PredictedPose(Pose):
    """The pose at which the surgeon's display draws the arm when the newest command has taken effect.

    The position is predicted; orientation and gripper are those of that command. Sampled when the command was.
    """

    hand: Literal["left", "right"] = Field(description="Hand whose arm is displayed.")
    tick: int = Field(ge=0, description="Number of the surgeon's tick, from 0, which is that of the command.")
    shown_tick: int = Field(ge=0, description="Number of the patient's tick whose feedback is displayed beside it.")
    shown_m: Vector3 = Field(description="Position of the arm in that feedback, in m.")
    command_ns: int = Field(description="Sample instant of the newest command behind that feedback, in ns.")
    round_trip_ns: int = Field(
        description="Time from that command to the arrival of the feedback, by the surgeon's clock, in ns."
    )


def position_m(pose: Pose) -> tuple[float, float, float]:
    """Return the pose's position as a tuple (x, y, z) in metres."""
    p = pose.position_m
    return (p.x, p.y, p.z)


def components(orientation: Quaternion) -> tuple[float, float, float, float]:
    """Return a message's quaternion as x, y, z, w."""
    return orientation.x, orientation.y, orientation.z, orientation.w
