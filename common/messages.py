"""Payloads on the wire: JSON of these models, in SI units. Their JSON Schemas are part of the logs.

Sequence number and send time travel in the attachment (`Header`), outside the payload.
"""

import struct
import threading
from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Annotated, Any, Final, Literal, NamedTuple, Self, TypeVar, get_args, get_type_hints

from msgspec import DecodeError, Meta, Struct, json, to_builtins

MAX_SIZE: Final = 1e9
"""Size of the largest number in a message. In metres it lies beyond the Moon; sums of its squares do not overflow."""

_MAX_STAMP: Final = 1 << 62
"""Size of the largest integer in a message, and of an instant in ns: 146 years. Differences of two fit 64 bits."""

MAX_HISTORY: Final = 256
"""Number of earlier poses in a message."""

Finite = Annotated[float, Meta(ge=-MAX_SIZE, le=MAX_SIZE)]
Instant = Annotated[int, Meta(ge=-_MAX_STAMP, le=_MAX_STAMP)]


class Message(Struct, frozen=True, forbid_unknown_fields=True, gc=False):
    """Base of every payload: immutable, no unknown fields, finite numbers up to `MAX_SIZE` only.

    `decode` checks the fields; what a side computes is checked where it is computed, as a message is built at each
    tick. No message refers to itself, so the garbage collector need not follow them.
    """


Decoded = TypeVar("Decoded", bound=Message)

_building: Final = threading.Lock()
_decoders: Final[dict[type[Message], json.Decoder[Any]]] = {}


def _plain(value: object) -> object:
    """Return a number or text of a derived type as itself: numpy's float64 is a float, also for mypy."""
    for kind in (float, int, str):
        if isinstance(value, kind):
            return kind(value)
    raise TypeError(f"no message holds a {type(value).__name__}")


encode: Final[Callable[[Message], bytes]] = json.Encoder(enc_hook=_plain).encode
"""Return a message's JSON."""


def as_row(message: Message) -> dict[str, Any]:
    """Return a message's fields as a reader of its JSON would find them."""
    row: dict[str, Any] = to_builtins(message, enc_hook=_plain)
    return row


def decode(payload: bytes, model: type[Decoded]) -> Decoded:
    """Return the message in a payload; raises `msgspec.DecodeError` for whatever is none."""
    try:
        found: Decoded = (_decoders.get(model) or _decoder(model)).decode(payload)
        return found
    except (UnicodeError, RecursionError) as error:
        raise DecodeError(str(error)) from None


def _decoder(model: type[Message]) -> json.Decoder[Any]:
    # One thread at a time: msgspec 0.22 shows a type to other threads before it is whole, and they crash.
    with _building:
        found = _decoders.get(model)
        if found is None:
            found = _decoders[model] = json.Decoder(model)
        return found


def meanings(model: type[Message]) -> Mapping[str, str]:
    """Return the description of each field; "" without one."""
    hints = get_type_hints(model, include_extras=True)
    notes = {name: [one for one in get_args(hint) if isinstance(one, Meta)] for name, hint in hints.items()}
    return {name: next((note.description for note in found if note.description), "") for name, found in notes.items()}


class Vector3(Message, frozen=True):
    """A vector in Cartesian coordinates; the unit is that of the field."""

    x: Annotated[Finite, Meta(description="Component along x.")]
    y: Annotated[Finite, Meta(description="Component along y.")]
    z: Annotated[Finite, Meta(description="Component along z.")]


class Quaternion(Message, frozen=True):
    """A unit quaternion, scalar last."""

    x: Annotated[Finite, Meta(description="Vector part, x.")]
    y: Annotated[Finite, Meta(description="Vector part, y.")]
    z: Annotated[Finite, Meta(description="Vector part, z.")]
    w: Annotated[Finite, Meta(description="Scalar part.")]


class Sampled(Message, frozen=True):
    """Base of every message that crosses the network: what it holds belongs to an instant."""

    sample_ns: Annotated[
        Instant, Meta(description="Run time at which the pose was sampled, or that it is estimated for, in ns.")
    ]


class Pose(Sampled, frozen=True):
    """A Cartesian pose of a tool tip, as in CRTK's ``measured_cp`` and ``setpoint_cp``."""

    position_m: Annotated[Vector3, Meta(description="Position of the tool tip, in m.")]
    orientation: Annotated[Quaternion, Meta(description="Orientation of the tool tip.")]
    gripper_rad: Annotated[Finite, Meta(description="Opening angle of the gripper, in rad.")]


class SampledPose(Pose, frozen=True, omit_defaults=True):
    """A pose of a sampled stream and, where the scenario configures a history, the poses before it.

    Without a history the payload holds the fields of `Pose` only.
    """

    history: Annotated[
        tuple[Pose, ...],
        Meta(max_length=MAX_HISTORY, description="Poses sampled before this one, by ascending sample_ns."),
    ] = ()

    def __post_init__(self) -> None:
        if self.history:
            instants = [*(pose.sample_ns for pose in self.history), self.sample_ns]
            if instants[0] < 0 or any(later <= sooner for sooner, later in pairwise(instants)):
                raise ValueError("history must be ordered by sample instant, and before the pose's own")


class FeedbackPose(Pose, frozen=True):
    """A pose from the patient's side, with the command that it answers, from which the round trip is measured."""

    tick: Annotated[int, Meta(ge=0, le=_MAX_STAMP, description="Number of the patient's tick, from 0.")]
    command_sample_ns: Annotated[
        Instant | None,
        Meta(description="Sample instant of the newest command at that tick, in ns; null: none has arrived."),
    ]


SafetyMode = Literal["tracking", "resuming", "hold", "slow_stop", "safe"]


class SetPoint(Pose, frozen=True):
    """The pose that drives the patient's arm, as in CRTK's ``servo_cp``: the active estimate within its limits."""

    hand: Annotated[Literal["left", "right"], Meta(description="Hand whose arm is driven.")]
    tick: Annotated[int, Meta(ge=0, description="Number of the patient's tick, from 0.")]
    mode: Annotated[SafetyMode, Meta(description="Safety state: tracking, resuming, hold, slow_stop or safe.")]
    age_ns: Annotated[int | None, Meta(description="Age of the newest sample, in ns; null: none has arrived.")]


class PredictedPose(Pose, frozen=True):
    """The pose at which the surgeon's display draws the arm when the newest command has taken effect.

    The position is predicted; orientation and gripper are those of that command. Sampled when the command was.
    """

    hand: Annotated[Literal["left", "right"], Meta(description="Hand whose arm is displayed.")]
    tick: Annotated[
        int, Meta(ge=0, description="Number of the surgeon's tick, from 0, which is that of the command.")
    ]
    shown_tick: Annotated[
        int, Meta(ge=0, description="Number of the patient's tick whose feedback is displayed beside it.")
    ]
    shown_m: Annotated[Vector3, Meta(description="Position of the arm in that feedback, in m.")]
    command_ns: Annotated[int, Meta(description="Sample instant of the newest command behind that feedback, in ns.")]
    round_trip_ns: Annotated[
        int, Meta(description="Time from that command to the arrival of the feedback, by the surgeon's clock, in ns.")
    ]


class Twist(Sampled, frozen=True):
    """How the hand moves, as in CRTK's ``measured_cs``, with what its coupling puts into the network."""

    velocity_m_s: Annotated[Vector3, Meta(description="Velocity of the hand over the last tick, in m/s.")]
    energy_j: Annotated[
        Finite | None, Meta(description="Energy that the hand has put in so far, in J; null: the coupling has none.")
    ] = None
    wave: Annotated[
        Vector3 | None, Meta(description="Wave of the last tick, in W^(1/2); null: the coupling has none.")
    ] = None


class Wrench(Sampled, frozen=True):
    """The force that the patient's side feeds back, as in CRTK's ``measured_cf``; torques are not measured."""

    tick: Annotated[int, Meta(ge=0, le=_MAX_STAMP, description="Number of the patient's tick, from 0.")]
    force_n: Annotated[
        Vector3, Meta(description="Force on the tool tip, in N; with wave and tdpa that of the arm's spring.")
    ]
    energy_j: Annotated[
        Finite | None, Meta(description="Energy that the arm has put in so far, in J; null: the coupling has none.")
    ]
    wave: Annotated[Vector3 | None, Meta(description="Wave of the tick, in W^(1/2); null: the coupling has none.")]
    active: Annotated[
        bool, Meta(description="false: the arm does not follow the hand, so the force fades and energies begin anew.")
    ]
    command_sample_ns: Annotated[
        Instant | None,
        Meta(description="Sample instant of the newest command at that tick, in ns; null: none has arrived."),
    ]


class ShownForce(Sampled, frozen=True):
    """The force that is shown to the hand or its device until the next tick, as in CRTK's ``servo_cf``."""

    hand: Annotated[Literal["left", "right"], Meta(description="Hand that feels the force.")]
    tick: Annotated[int, Meta(ge=0, description="Number of the surgeon's tick, from 0.")]
    position_m: Annotated[Vector3, Meta(description="Where the hand is at the tick, as the commanded arm, in m.")]
    intended_m: Annotated[Vector3, Meta(description="Where it intends to be, in m; a live device: where it is.")]
    force_n: Annotated[Vector3, Meta(description="Force on the hand, in N.")]
    age_ns: Annotated[int | None, Meta(description="Time since the newest force arrived, in ns; null: none has.")]
    limited: Annotated[
        Literal["", "force", "stale", "inactive"],
        Meta(description="Why it is less than asked for: force_max_n, its age, an arm that does not follow."),
    ]
    sent: Annotated[bool, Meta(description="false: the deadband kept the movement of this tick back.")]
    command_ns: Annotated[
        int | None, Meta(description="Sample instant of the newest command behind the force, in ns; null: none.")
    ]


class Fragment(Sampled, frozen=True):
    """What a fragment of a frame says of itself. Logs hold this in place of its bytes; ``sample_ns``: the capture."""

    frame: Annotated[int, Meta(ge=0, description="Number of the frame, from 0.")]
    index: Annotated[int, Meta(ge=0, description="Number of the fragment in its frame, from 0.")]
    n_fragments: Annotated[int, Meta(ge=1, description="Number of the frame's fragments.")]
    frame_bytes: Annotated[int, Meta(ge=1, description="Size of the encoded frame, in bytes.")]
    checksum: Annotated[int, Meta(description="CRC-32 of the fragment.")]


def position_m(pose: Pose) -> tuple[float, float, float]:
    """Return the pose's position as a tuple (x, y, z) in metres."""
    p = pose.position_m
    return (p.x, p.y, p.z)


def components(orientation: Quaternion) -> tuple[float, float, float, float]:
    """Return a message's quaternion as x, y, z, w."""
    return orientation.x, orientation.y, orientation.z, orientation.w


# The 20-byte header in the Zenoh attachment of every message of the testbed.
#
# It identifies the packet without decoding its payload, so that netem can address a fate by sequence number, and it
# carries the send time, which is known only after the payload has been encoded. The run's number, which netem draws
# and gives with the epoch, tells a message of another run, such as one that a side left behind.

_LAYOUT: Final = struct.Struct("<4sIqI")
HEADER_BYTES: Final = _LAYOUT.size
CODE_BYTES: Final = 16
"""Bytes behind the header of a signed message (`tis.common.signing`)."""
_LENGTHS: Final = (HEADER_BYTES, HEADER_BYTES + CODE_BYTES)
_MAGIC: Final = b"tis\x02"  # the last byte is the version of the layout


class Header(NamedTuple):
    """Sequence number of the packet on its key, run time (ns) of its sending, and number of its run."""

    seq: int
    sent_ns: int = 0
    run_id: int = 0

    def pack(self) -> bytes:
        """Return the attachment's bytes; raises `struct.error` for numbers beyond 32, 64 and 32 bits."""
        return _LAYOUT.pack(_MAGIC, self.seq, self.sent_ns, self.run_id)

    @classmethod
    def unpack(cls, attachment: bytes) -> Self | None:
        """Return the header, or None for a foreign attachment (oracle: tests/common/test_header)."""
        numbers = header_numbers(attachment)
        return None if numbers is None else cls(*numbers)


def header_numbers(attachment: bytes) -> tuple[int, int, int] | None:
    """Return the fields of a header as a plain tuple, which netem makes for each packet; None for a foreign one."""
    if len(attachment) not in _LENGTHS or not attachment.startswith(_MAGIC):
        return None
    _, seq, sent_ns, run_id = _LAYOUT.unpack_from(attachment)
    return seq, sent_ns, run_id
