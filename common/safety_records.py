"""Records of what protects the arm: samples in quarantine, safety states and emergency stops."""

from typing import Literal

from pydantic import Field

from common.channels import Hand
from common.messages import Message, SafetyMode


class QuarantineNote(Message):
    """A message on a key of the testbed that the patient received and did not use."""

    key: str = Field(description="Zenoh key of the message.")
    seq: int = Field(description="Sequence number of the message.")
    recv_ns: int = Field(description="Run time of its arrival, in ns.")
    sample_ns: int = Field(description="Sample instant that it states, in ns.")
    x_m: float = Field(description="Position that it states, x, in m.")
    y_m: float = Field(description="Position that it states, y, in m.")
    z_m: float = Field(description="Position that it states, z, in m.")
    kind: str = Field(
        description="conflicting: another content came before under its number; ahead: sampled later than now; "
        "number: its number is not that of its sample; place, speed, acceleration: beyond what an arm can do."
    )


QUARANTINE = "/tis/quarantine"
QUARANTINED = "quarantined"


SafetyCause = Literal[
    "first", "age", "uncertainty", "conflict", "no_estimate", "emergency_stop", "latched", "break", "sound", "met"
]


class SafetyNote(Message):
    """A change of an arm's safety state."""

    t_ns: int = Field(description="Instant of the tick at which it changed, in ns.")
    hand: Hand = Field(description="Hand whose arm is concerned.")
    before: SafetyMode = Field(description="State until then.")
    mode: SafetyMode = Field(description="State from then on: tracking, resuming, hold, slow_stop or safe.")
    cause: SafetyCause = Field(
        description="first: the first estimate; age, uncertainty, no_estimate: the data became unsound; conflict: "
        "samples came in two versions, so some are forged; "
        "emergency_stop; latched: safe until a release; break: the data came back after a gap; sound: the data are "
        "sound again; met: the set point met the estimate."
    )
    age_ns: int | None = Field(description="Age of the newest sample, in ns; null: none has arrived.")


SAFETY = "/tis/safety"


class StopNote(Message):
    """An emergency stop, or its release, as it reached the patient."""

    at_ns: int = Field(description="Run time of its arrival, in ns.")
    stop: bool = Field(description="true: stop; false: release.")
    reason: str = Field(max_length=200, description="Reason that was given.")


STOPS = "/tis/emergency_stops"
