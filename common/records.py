"""Records that each side logs beside the messages. The models are flat: viewers refuse references and maps."""

from typing import Annotated, Final, Literal

from msgspec import Meta

from tis.common.channels import Direction, Hand, Side
from tis.common.messages import Message, Quaternion, Vector3
from tis.common.peer_life import Event
from tis.common.topic import Topic


class Rejected(Message, frozen=True):
    """A foreign or damaged message on a key of the testbed. It is counted, and the run continues."""

    key: Annotated[str, Meta(description="Zenoh key of the message.")]
    recv_ns: Annotated[int, Meta(description="Run time of its arrival, in ns.")]
    reason: Annotated[str, Meta(description="Reason for the rejection.")]
    head_hex: Annotated[str, Meta(max_length=64, description="First 32 bytes of the payload, hexadecimal.")]


REJECTED = Topic("/tis/rejected", Rejected, stamps=("recv_ns",))

_HAND: Final = "Hand whose arm is concerned."
_TICK: Final = "Number of the patient's tick, from 0."
_ESTIMATOR: Final = "Name of the estimator."
_POSITION: Final = "Estimated position, in m; null: the estimator had none."
_STD: Final = "Standard deviation that the estimator states for the position, in m; null: it states none."
_ORIENTATION: Final = "Estimated orientation of the tool tip; null: the method had none."
_TURN_STD: Final = (
    "Standard deviation that the method states for the orientation, about the axes of the estimated frame, in rad; "
    "null: it states none."
)
_GRIPPER: Final = "Estimated opening angle of the gripper, in rad; null: the method had none."
_GRIPPER_STD: Final = "Standard deviation that the method states for the gripper, in rad; null: it states none."
_STEP: Final = "Computation time of the estimator's step, in ns; 0 in virtual time."
_SEQ_SAMPLE: Final = "Sequence number of the packet that brought the sample."
_OFFERED: Final = "Run time at which each packet was offered to netem, in ns."
_KEY: Final = "Zenoh key of the packets."
_DIRECTION: Final = "forward: west to east, in a run surgeon to patient; feedback: back."
_FOREIGN: Final = "true: the packets have no header of the testbed, so netem numbered them itself."


class PeerNote(Message, frozen=True):
    """A change in the life of a side, noticed by this side while the run was going on."""

    at_ns: Annotated[int, Meta(description="Run time at which it was noticed, in ns.")]
    peer: Annotated[Side, Meta(description="The side concerned: surgeon, netem or patient; it may be this one.")]
    event: Annotated[
        Event,
        Meta(
            description="left: its process ended; frozen: it stands still; link_down: nothing gets through to it; "
            "silent: one of these; back: it is heard again; stalled: its loop stays in one step; resumed: it goes "
            "on; clock_step: its clock stepped; suspended: its host was; conflict: it receives samples in two "
            "versions; foreign_set_point: it hears set points for its arm that it did not send; foreign_release: a "
            "release came from another than the stopper; stop_flood: requests to stop or to release flood it; "
            "foreign_beat: somebody else sends its signs of life; forged: what it receives is not signed; "
            "unsigned_stop: nobody has signed a stop, which was carried out."
        ),
    ]
    for_ns: Annotated[int, Meta(description="How long it has been so, or how far the clock stepped, in ns.")]
    doing: Annotated[str, Meta(description="Step in which a loop stays; empty: none, or not known.")]


PEERS = Topic("/tis/peers", PeerNote, stamps=("at_ns",))


class TruthRow(Message, frozen=True):
    """The recorded arm at one sample instant, for scoring; it is never sent."""

    hand: Annotated[Hand, Meta(description=_HAND)]
    index: Annotated[int, Meta(description="Number of the sample, from 0.")]
    sample_ns: Annotated[int, Meta(description="Sample instant in run time, in ns.")]
    position_m: Annotated[Vector3, Meta(description="Recorded position of the arm, in m.")]
    rotation_rad: Annotated[
        Vector3 | None, Meta(description="Orientation as a rotation vector (axis * angle), in rad.")
    ] = None
    gripper_rad: Annotated[float | None, Meta(description="Opening angle of the gripper, in rad.")] = None


TRUTH = Topic("/tis/truth", TruthRow, stamps=("sample_ns",), is_frequent=True)


class TickNote(Message, frozen=True):
    """A tick of this side, begun or missed."""

    tick: Annotated[int, Meta(description="Number of the tick, from 0.")]
    due_ns: Annotated[int, Meta(description="Nominal instant of the tick in run time, in ns.")]
    begin_ns: Annotated[
        int, Meta(description="Run time at which it began, or at which it was found to be missed, in ns.")
    ]
    missed: Annotated[bool, Meta(description="true: the tick had not begun when the next one was due.")] = False


TICKS = Topic("/tis/ticks", TickNote, stamps=("due_ns", "begin_ns"), is_frequent=True)


class EstimateNote(Message, frozen=True):
    """The output of one estimator at one tick, for one hand."""

    tick: Annotated[int, Meta(description=_TICK)]
    t_ns: Annotated[int, Meta(description="Nominal instant of the tick, for which the position is estimated, in ns.")]
    hand: Annotated[Hand, Meta(description=_HAND)]
    estimator: Annotated[str, Meta(description=_ESTIMATOR)]
    position_m: Annotated[Vector3 | None, Meta(description=_POSITION)]
    std_m: Annotated[Vector3 | None, Meta(description=_STD)] = None
    step_ns: Annotated[int, Meta(description=_STEP)] = 0


ESTIMATES = Topic(
    "/tis/estimates", EstimateNote, stamps=("t_ns",), is_group=True, is_frequent=True, is_recomputable=True
)


class OrientationNote(Message, frozen=True):
    """The output of one orientation method at one tick, for one hand."""

    tick: Annotated[int, Meta(description=_TICK)]
    t_ns: Annotated[
        int, Meta(description="Nominal instant of the tick, for which the orientation is estimated, in ns.")
    ]
    hand: Annotated[Hand, Meta(description=_HAND)]
    method: Annotated[str, Meta(description="Name of the orientation method.")]
    orientation: Annotated[Quaternion | None, Meta(description=_ORIENTATION)]
    std_rad: Annotated[Vector3 | None, Meta(description=_TURN_STD)] = None
    gripper_rad: Annotated[float | None, Meta(description=_GRIPPER)] = None
    gripper_std_rad: Annotated[float | None, Meta(description=_GRIPPER_STD)] = None
    step_ns: Annotated[int, Meta(description=_STEP)] = 0


ORIENTATIONS = Topic(
    "/tis/orientations", OrientationNote, stamps=("t_ns",), is_group=True, is_frequent=True, is_recomputable=True
)


class EstimatorFault(Message, frozen=True):
    """The first failure of a user-defined estimator, for one hand; a counter holds the number of failures."""

    t_ns: Annotated[int, Meta(description="Run time of the failure, in ns.")]
    hand: Annotated[Hand, Meta(description=_HAND)]
    estimator: Annotated[str, Meta(description=_ESTIMATOR)]
    reason: Annotated[str, Meta(description="Exception or rule that made the step fail.")]


ESTIMATOR_FAULTS = Topic("/tis/estimator_faults", EstimatorFault, stamps=("t_ns",))
FAULTY_STEPS = "faulty_steps"


class FreshNote(Message, frozen=True):
    """The freshest command sample that a tick used, from which the end-to-end latency is computed."""

    tick: Annotated[int, Meta(description=_TICK)]
    hand: Annotated[Hand, Meta(description=_HAND)]
    key: Annotated[str, Meta(description="Zenoh key on which the sample arrived.")]
    seq: Annotated[int, Meta(description=_SEQ_SAMPLE)]
    sample_ns: Annotated[int, Meta(description="Sample instant in run time, in ns.")]
    answer: Annotated[
        int | None, Meta(description="Sequence number of the published estimate; null: it equals the tick's number.")
    ] = None


FRESH = Topic("/tis/fresh", FreshNote, samples=("sample_ns",), is_frequent=True, is_recomputable=True)


class PromptNote(Message, frozen=True):
    """An estimate of the active estimator between ticks, made when a fresher sample arrived, for one hand."""

    t_ns: Annotated[int, Meta(description="Run time of the arrival, for which the position is estimated, in ns.")]
    begin_ns: Annotated[int, Meta(description="Run time at which the step began, in ns.")]
    hand: Annotated[Hand, Meta(description=_HAND)]
    estimator: Annotated[str, Meta(description=_ESTIMATOR)]
    key: Annotated[str, Meta(description="Zenoh key on which the sample arrived.")]
    seq: Annotated[int, Meta(description=_SEQ_SAMPLE)]
    sample_ns: Annotated[int, Meta(description="Sample instant in run time, in ns.")]
    answer: Annotated[
        int | None, Meta(description="Sequence number of the published estimate; null: there was none.")
    ]
    position_m: Annotated[Vector3 | None, Meta(description=_POSITION)]
    std_m: Annotated[Vector3 | None, Meta(description=_STD)] = None
    orientation: Annotated[Quaternion | None, Meta(description=_ORIENTATION)] = None
    turn_std_rad: Annotated[Vector3 | None, Meta(description=_TURN_STD)] = None
    gripper_rad: Annotated[float | None, Meta(description=_GRIPPER)] = None
    gripper_std_rad: Annotated[float | None, Meta(description=_GRIPPER_STD)] = None
    step_ns: Annotated[int, Meta(description=_STEP)] = 0


PROMPT = Topic(
    "/tis/prompt_estimates", PromptNote, stamps=("t_ns", "begin_ns"), samples=("sample_ns",), is_frequent=True
)


class PhaseNote(Message, frozen=True):
    """A change of the tick phase; mean ages are over the recent arrivals."""

    tick: Annotated[int, Meta(description="Last tick with the previous phase.")]
    phase_ns: Annotated[int, Meta(description="Offset of the following ticks from the sample instants, in ns.")]
    age_ns: Annotated[int, Meta(description="Mean age of the freshest sample at ticks of the new phase, in ns.")]
    age_before_ns: Annotated[
        int, Meta(description="Mean age of the freshest sample at ticks of the previous phase, in ns.")
    ]


PHASES = Topic("/tis/tick_phases", PhaseNote)


class PlantNote(Message, frozen=True):
    """The arm of the plant at a tick."""

    tick: Annotated[int, Meta(description=_TICK)]
    t_ns: Annotated[int, Meta(description="Nominal instant of the tick, in ns.")]
    hand: Annotated[Hand, Meta(description=_HAND)]
    position_m: Annotated[Vector3, Meta(description="Position of the plant's arm, in m.")]
    age_ns: Annotated[
        int | None,
        Meta(description="Age of an external arm's pose, counted from its arrival, in ns; null: a plant of ours."),
    ] = None
    clamped: Annotated[
        bool, Meta(description="True: the set point in force lies outside what the arm's joints reach.")
    ] = False


class ContactNote(Message, frozen=True):
    """What an arm touches at a tick; only runs with touch have it."""

    tick: Annotated[int, Meta(description=_TICK)]
    t_ns: Annotated[int, Meta(description="Nominal instant of the tick, in ns.")]
    hand: Annotated[Hand, Meta(description=_HAND)]
    force_n: Annotated[Vector3, Meta(description="Force of the environment on the tool tip, in N.")]
    sent: Annotated[bool, Meta(description="false: the deadband kept the force back.")]
    active: Annotated[bool, Meta(description="false: the arm does not follow the hand.")]


CONTACTS = Topic("/tis/contacts", ContactNote, stamps=("t_ns",), is_frequent=True, is_recomputable=True)

PLANT = Topic("/tis/plant", PlantNote, stamps=("t_ns",), is_frequent=True, is_recomputable=True)

Outcome = Literal["deliver", "loss", "outage", "refused", "overflow", "queue_full"]
"""Decision on a packet when it is offered. ``deliver``: it is held, or waits in the queue of a rate."""

Departure = Literal["released", "late", "codel", "evicted", "queue_full"]
"""Departure of a held packet: released, or dropped.

It is dropped as overtaken (late), by CoDel, by the policy of a full buffer (evicted), or from a full queue, for a
message of a higher priority.
"""


class FateBatch(Message, frozen=True):
    """Decisions on packets of one key, column by column, in the order of offering."""

    direction: Annotated[Direction, Meta(description=_DIRECTION)]
    key: Annotated[str, Meta(description=_KEY)]
    foreign: Annotated[bool, Meta(description=_FOREIGN)] = False
    seq: Annotated[tuple[int, ...], Meta(description="Sequence number of each packet.")] = ()
    offered_ns: Annotated[tuple[int, ...], Meta(description=_OFFERED)] = ()
    outcome: Annotated[
        tuple[Outcome, ...],
        Meta(
            description="Decision: deliver, or dropped by a loss model (loss), by an outage, as no rule admits the "
            "key (refused), by a full buffer (overflow) or a full queue (queue_full)."
        ),
    ] = ()
    delay_ns: Annotated[
        tuple[int, ...], Meta(description="Delay drawn by the models, without queue and ordering, in ns.")
    ] = ()
    release_ns: Annotated[
        tuple[int, ...],
        Meta(
            description="Decided run time of the release, after ordering, in ns; 0 where the packet is dropped, or "
            "where a queue decides later (see the release batch)."
        ),
    ] = ()
    n_bytes: Annotated[tuple[int, ...], Meta(description="Size of the payload, in bytes.")] = ()
    copies: Annotated[
        tuple[int, ...], Meta(description="Number of copies that netem made, the original not counted.")
    ] = ()
    flipped: Annotated[tuple[int, ...], Meta(description="Number of flipped payload bits.")] = ()
    recovered: Annotated[
        tuple[int, ...],
        Meta(
            description="1 where the first sending is lost, and a recovery repeats it; empty: nowhere in the batch."
        ),
    ] = ()


FATES = Topic("/tis/fates", FateBatch, is_frequent=True)


class ReleaseBatch(Message, frozen=True):
    """Departures of packets of one key from netem, column by column, in the order of departure."""

    direction: Annotated[Direction, Meta(description=_DIRECTION)]
    key: Annotated[str, Meta(description=_KEY)]
    foreign: Annotated[bool, Meta(description=_FOREIGN)] = False
    seq: Annotated[tuple[int, ...], Meta(description="Sequence number of each packet.")] = ()
    copy_index: Annotated[tuple[int, ...], Meta(description="Number of the copy; 0: the original.")] = ()
    offered_ns: Annotated[tuple[int, ...], Meta(description=_OFFERED)] = ()
    release_ns: Annotated[tuple[int, ...], Meta(description="Decided run time of the release, in ns.")] = ()
    released_ns: Annotated[
        tuple[int, ...], Meta(description="Measured run time of the release, in ns; 0 where the packet was dropped.")
    ] = ()
    departure: Annotated[
        tuple[Departure, ...],
        Meta(
            description="released, or the reason of the drop: overtaken (late), CoDel (codel), policy of a full "
            "buffer (evicted), a full queue that makes room for a higher priority (queue_full)."
        ),
    ] = ()
    queued_ns: Annotated[
        tuple[int, ...], Meta(description="Time in the queue of a rate, transmission included, in ns.")
    ] = ()
    recovered_ns: Annotated[
        tuple[int, ...],
        Meta(
            description="Delay that a recovery added, by repeats of this packet and of earlier ones, in ns; empty: "
            "none in the batch."
        ),
    ] = ()


RELEASES = Topic("/tis/releases", ReleaseBatch, is_frequent=True)


class QueueNote(Message, frozen=True):
    """The depth of a rate's queue, sampled when a packet is offered to it, at most every 10 ms of run time."""

    direction: Annotated[Direction, Meta(description=_DIRECTION)]
    at_ns: Annotated[int, Meta(description="Run time of the sample, in ns.")]
    n_packets: Annotated[int, Meta(description="Number of packets in the queue.")]
    n_bytes: Annotated[int, Meta(description="Number of bytes in the queue, overhead included.")]


QUEUES = Topic("/tis/queues", QueueNote)


class ControlNote(Message, frozen=True, kw_only=True):
    """A request to change the network during the run, accepted or refused."""

    at_ns: Annotated[int, Meta(description="Run time of the request, in ns.")]
    applied_ns: Annotated[int, Meta(description="Run time from which the change holds, in ns; 0 when refused.")]
    operation: Annotated[str, Meta(description="set, outage, reset or profile; any text when refused.")] = "set"
    request: Annotated[str, Meta(description="The request as JSON, truncated.")]
    added: Annotated[str, Meta(description="Resulting entries of the timeline, as a JSON list.")] = ""
    accepted: Annotated[bool, Meta(description="true: the change was made; false: it was refused.")]
    reason: Annotated[str, Meta(description="Reason for a refusal.")] = ""


CONTROL = Topic("/tis/control", ControlNote)

SENT_PACKETS = "sent_packets"
UNRECORDED = "unrecorded"
SENT_BYTES = "sent_bytes"


class CounterNote(Message, frozen=True):
    """A counter of a side at the end of the run."""

    name: Annotated[
        str,
        Meta(
            description="Name of the counter. The surgeon's traffic on a key is in sent_packets.KEY and "
            "sent_bytes.KEY, the failed steps of a user-defined estimator, over all hands, in "
            "faulty_steps.ESTIMATOR, the records that a log lacks since the disk was too slow in unrecorded.TOPIC."
        ),
    ]
    value: Annotated[int, Meta(description="Final value.")]


COUNTERS = Topic("/tis/counters", CounterNote)
