"""Records of what protects the arm: samples in quarantine, safety states and emergency stops."""

from typing import Literal

from pydantic import Field

from tis.common.channels import Hand
from tis.common.messages import Message, SafetyMode
from tis.common.topic import Topic


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
        "number: its number is not that of its sample; place, speed, acceleration, turn_speed, turn_acceleration, "
        "gripper: beyond what an arm can do; foreign_set_point: a set point that the patient did not send."
    )


QUARANTINE = Topic("/tis/quarantine", QuarantineNote, stamps=("recv_ns",))
QUARANTINED = "quarantined"
SINCE_MS = "since_ms"
"""Counters ``since_ms.ALARM`` hold the run time at which an alarm began."""


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


SAFETY = Topic("/tis/safety", SafetyNote, stamps=("t_ns",))


class StopNote(Message):
    """A request to stop or to release, as the patient took it; fields with defaults are absent in older logs."""

    at_ns: int = Field(description="Run time of its arrival, in ns.")
    stop: bool = Field(description="true: stop; false: release.")
    reason: str = Field(max_length=200, description="Reason that was given.")
    number: int = Field(0, description="Number of the request; of a stop that under which it is in force.")
    ends: int = Field(0, description="Number of the stop that a release ends.")
    by_stopper: bool | None = Field(
        None,
        description="Whether a release had the secret of the stop; null: that has none, or it is no release.",
    )
    stopped: bool | None = Field(None, description="Whether the arms are stopped after it; null: as in stop.")
    changed: bool | None = Field(None, description="Whether they were not before; null: not known.")
    refused: str = Field("", max_length=200, description="Why it was not carried out; empty: it was.")

    @property
    def leaves_stopped(self) -> bool:
        """Whether the arms are stopped after it."""
        return self.stop if self.stopped is None else self.stopped


STOPS = Topic("/tis/emergency_stops", StopNote, stamps=("at_ns",))


class StopsInForceNote(Message):
    """The stops in force after a change, as a patient that is started anew needs them."""

    at_ns: int = Field(description="Run time of the change, in ns.")
    stops: str = Field(
        "",
        pattern=r"^([0-9]{1,16}:([0-9a-f]{64})?( [0-9]{1,16}:([0-9a-f]{64})?)*)?$",
        description="NUMBER:LOCK of each of the newest stops, the oldest first.",
    )
    others: int = Field(0, ge=0, description="Number of older stops in force.")
    given: int = Field(0, ge=0, lt=1 << 52, description="Numbers that the patient has given to stops.")


STOPS_IN_FORCE = Topic("/tis/stops_in_force", StopsInForceNote, stamps=("at_ns",))
