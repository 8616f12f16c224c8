"""Records of what protects the arm: samples in quarantine, safety states and emergency stops."""

from typing import Annotated, Literal

from msgspec import Meta

from tis.common.channels import Hand
from tis.common.messages import Message, SafetyMode
from tis.common.topic import Topic


class QuarantineNote(Message, frozen=True):
    """A message on a key of the testbed that the patient received and did not use."""

    key: Annotated[str, Meta(description="Zenoh key of the message.")]
    seq: Annotated[int, Meta(description="Sequence number of the message.")]
    recv_ns: Annotated[int, Meta(description="Run time of its arrival, in ns.")]
    sample_ns: Annotated[int, Meta(description="Sample instant that it states, in ns.")]
    x_m: Annotated[float, Meta(description="Position that it states, x, in m.")]
    y_m: Annotated[float, Meta(description="Position that it states, y, in m.")]
    z_m: Annotated[float, Meta(description="Position that it states, z, in m.")]
    kind: Annotated[
        str,
        Meta(
            description="conflicting: another content came before under its number; ahead: sampled later than now; "
            "number: its number is not that of its sample; place, speed, acceleration, turn_speed, "
            "turn_acceleration, gripper: beyond what an arm can do; foreign_set_point: a set point that the patient "
            "did not send."
        ),
    ]


QUARANTINE = Topic("/tis/quarantine", QuarantineNote, stamps=("recv_ns",))
QUARANTINED = "quarantined"
SINCE_MS = "since_ms"
"""Counters ``since_ms.ALARM`` hold the run time at which an alarm began."""


SafetyCause = Literal[
    "first",
    "age",
    "uncertainty",
    "conflict",
    "no_estimate",
    "emergency_stop",
    "latched",
    "contact",
    "break",
    "sound",
    "met",
]


class SafetyNote(Message, frozen=True):
    """A change of an arm's safety state."""

    t_ns: Annotated[int, Meta(description="Instant of the tick at which it changed, in ns.")]
    hand: Annotated[Hand, Meta(description="Hand whose arm is concerned.")]
    before: Annotated[SafetyMode, Meta(description="State until then.")]
    mode: Annotated[SafetyMode, Meta(description="State from then on: tracking, resuming, hold, slow_stop or safe.")]
    cause: Annotated[
        SafetyCause,
        Meta(
            description="first: the first estimate; age, uncertainty, no_estimate: the data became unsound; "
            "conflict: samples came in two versions, so some are forged; emergency_stop; latched: safe until a "
            "release; contact: the arm was pressed too hard; break: the data came back after a gap; "
            "sound: the data are sound again; met: the set point met the estimate."
        ),
    ]
    age_ns: Annotated[int | None, Meta(description="Age of the newest sample, in ns; null: none has arrived.")]


SAFETY = Topic("/tis/safety", SafetyNote, stamps=("t_ns",))


class StopNote(Message, frozen=True):
    """A request to stop or to release, as the patient took it; fields with defaults are absent in older logs."""

    at_ns: Annotated[int, Meta(description="Run time of its arrival, in ns.")]
    stop: Annotated[bool, Meta(description="true: stop; false: release.")]
    reason: Annotated[str, Meta(max_length=200, description="Reason that was given.")]
    number: Annotated[int, Meta(description="Number of the request; of a stop that under which it is in force.")] = 0
    ends: Annotated[int, Meta(description="Number of the stop that a release ends.")] = 0
    by_stopper: Annotated[
        bool | None,
        Meta(description="Whether a release had the secret of the stop; null: that has none, or it is no release."),
    ] = None
    stopped: Annotated[bool | None, Meta(description="Whether the arms are stopped after it; null: as in stop.")] = (
        None
    )
    changed: Annotated[bool | None, Meta(description="Whether they were not before; null: not known.")] = None
    signer: Annotated[
        str, Meta(description="Name that signed it; -: nobody who may; empty: messages are not signed.")
    ] = ""
    refused: Annotated[str, Meta(max_length=200, description="Why it was not carried out; empty: it was.")] = ""

    @property
    def leaves_stopped(self) -> bool:
        """Whether the arms are stopped after it."""
        return self.stop if self.stopped is None else self.stopped


STOPS = Topic("/tis/emergency_stops", StopNote, stamps=("at_ns",))


class StopsInForceNote(Message, frozen=True):
    """The stops in force after a change, as a patient that is started anew needs them."""

    at_ns: Annotated[int, Meta(description="Run time of the change, in ns.")]
    stops: Annotated[
        str,
        Meta(
            pattern=r"^([0-9]{1,16}:([0-9a-f]{64})?( [0-9]{1,16}:([0-9a-f]{64})?)*)?$(?!\n)",
            description="NUMBER:LOCK of each of the newest stops, the oldest first.",
        ),
    ] = ""
    others: Annotated[int, Meta(ge=0, description="Number of older stops in force.")] = 0
    given: Annotated[int, Meta(ge=0, lt=1 << 52, description="Numbers that the patient has given to stops.")] = 0


STOPS_IN_FORCE = Topic("/tis/stops_in_force", StopsInForceNote, stamps=("at_ns",))
