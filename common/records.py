"""Records that each side logs beside the messages. The models are flat: viewers refuse references and maps."""

from typing import Final, Literal

from pydantic import Field

from tis.common.channels import Direction, Hand, Side
from tis.common.messages import Message, Quaternion, Vector3
from tis.common.peer_life import Event
from tis.common.topic import Topic


class Rejected(Message):
    """A foreign or damaged message on a key of the testbed. It is counted, and the run continues."""

    key: str = Field(description="Zenoh key of the message.")
    recv_ns: int = Field(description="Run time of its arrival, in ns.")
    reason: str = Field(description="Reason for the rejection.")
    head_hex: str = Field(max_length=64, description="First 32 bytes of the payload, hexadecimal.")


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
_DIRECTION: Final = "forward: surgeon to patient; feedback: patient to surgeon."
_FOREIGN: Final = "true: the packets have no header of the testbed, so netem numbered them itself."


class PeerNote(Message):
    """A change in the life of a side, noticed by this side while the run was going on."""

    at_ns: int = Field(description="Run time at which it was noticed, in ns.")
    peer: Side = Field(description="The side concerned: surgeon, netem or patient; it may be this one.")
    event: Event = Field(
        description="left: its process ended; frozen: it stands still; link_down: nothing gets through to it; "
        "silent: one of these; back: it is heard again; stalled: its loop stays in one step; resumed: it goes on; "
        "clock_step: its clock stepped; suspended: its host was; conflict: it receives samples in two versions; "
        "foreign_set_point: it hears set points for its arm that it did not send; foreign_release: a release came "
        "from another than the stopper; stop_flood: requests to stop or to release flood it.",
    )
    for_ns: int = Field(description="How long it has been so, or how far the clock stepped, in ns.")
    doing: str = Field(description="Step in which a loop stays; empty: none, or not known.")


PEERS = Topic("/tis/peers", PeerNote, stamps=("at_ns",))


class TruthRow(Message):
    """The recorded arm at one sample instant, for scoring; it is never sent."""

    hand: Hand = Field(description=_HAND)
    index: int = Field(description="Number of the sample, from 0.")
    sample_ns: int = Field(description="Sample instant in run time, in ns.")
    position_m: Vector3 = Field(description="Recorded position of the arm, in m.")
    rotation_rad: Vector3 | None = Field(None, description="Orientation as a rotation vector (axis * angle), in rad.")
    gripper_rad: float | None = Field(None, description="Opening angle of the gripper, in rad.")


TRUTH = Topic("/tis/truth", TruthRow, stamps=("sample_ns",), is_frequent=True)


class TickNote(Message):
    """A tick of this side, begun or missed."""

    tick: int = Field(description="Number of the tick, from 0.")
    due_ns: int = Field(description="Nominal instant of the tick in run time, in ns.")
    begin_ns: int = Field(description="Run time at which it began, or at which it was found to be missed, in ns.")
    missed: bool = Field(False, description="true: the tick had not begun when the next one was due.")


TICKS = Topic("/tis/ticks", TickNote, stamps=("due_ns", "begin_ns"), is_frequent=True)


class EstimateNote(Message):
    """The output of one estimator at one tick, for one hand."""

    tick: int = Field(description=_TICK)
    t_ns: int = Field(description="Nominal instant of the tick, for which the position is estimated, in ns.")
    hand: Hand = Field(description=_HAND)
    estimator: str = Field(description=_ESTIMATOR)
    position_m: Vector3 | None = Field(description=_POSITION)
    std_m: Vector3 | None = Field(None, description=_STD)
    step_ns: int = Field(0, description=_STEP)


ESTIMATES = Topic(
    "/tis/estimates", EstimateNote, stamps=("t_ns",), is_group=True, is_frequent=True, is_recomputable=True
)


class OrientationNote(Message):
    """The output of one orientation method at one tick, for one hand."""

    tick: int = Field(description=_TICK)
    t_ns: int = Field(description="Nominal instant of the tick, for which the orientation is estimated, in ns.")
    hand: Hand = Field(description=_HAND)
    method: str = Field(description="Name of the orientation method.")
    orientation: Quaternion | None = Field(description=_ORIENTATION)
    std_rad: Vector3 | None = Field(None, description=_TURN_STD)
    gripper_rad: float | None = Field(None, description=_GRIPPER)
    gripper_std_rad: float | None = Field(None, description=_GRIPPER_STD)
    step_ns: int = Field(0, description=_STEP)


ORIENTATIONS = Topic(
    "/tis/orientations", OrientationNote, stamps=("t_ns",), is_group=True, is_frequent=True, is_recomputable=True
)


class EstimatorFault(Message):
    """The first failure of a user-defined estimator, for one hand; a counter holds the number of failures."""

    t_ns: int = Field(description="Run time of the failure, in ns.")
    hand: Hand = Field(description=_HAND)
    estimator: str = Field(description=_ESTIMATOR)
    reason: str = Field(description="Exception or rule that made the step fail.")


ESTIMATOR_FAULTS = Topic("/tis/estimator_faults", EstimatorFault, stamps=("t_ns",))
FAULTY_STEPS = "faulty_steps"


class FreshNote(Message):
    """The freshest command sample that a tick used, from which the end-to-end latency is computed."""

    tick: int = Field(description=_TICK)
    hand: Hand = Field(description=_HAND)
    key: str = Field(description="Zenoh key on which the sample arrived.")
    seq: int = Field(description=_SEQ_SAMPLE)
    sample_ns: int = Field(description="Sample instant in run time, in ns.")
    answer: int | None = Field(
        None, description="Sequence number of the published estimate; null: it equals the tick's number."
    )


FRESH = Topic("/tis/fresh", FreshNote, samples=("sample_ns",), is_frequent=True, is_recomputable=True)


class PromptNote(Message):
    """An estimate of the active estimator between ticks, made when a fresher sample arrived, for one hand."""

    t_ns: int = Field(description="Run time of the arrival, for which the position is estimated, in ns.")
    begin_ns: int = Field(description="Run time at which the step began, in ns.")
    hand: Hand = Field(description=_HAND)
    estimator: str = Field(description=_ESTIMATOR)
    key: str = Field(description="Zenoh key on which the sample arrived.")
    seq: int = Field(description=_SEQ_SAMPLE)
    sample_ns: int = Field(description="Sample instant in run time, in ns.")
    answer: int | None = Field(description="Sequence number of the published estimate; null: there was none.")
    position_m: Vector3 | None = Field(description=_POSITION)
    std_m: Vector3 | None = Field(None, description=_STD)
    orientation: Quaternion | None = Field(None, description=_ORIENTATION)
    turn_std_rad: Vector3 | None = Field(None, description=_TURN_STD)
    gripper_rad: float | None = Field(None, description=_GRIPPER)
    gripper_std_rad: float | None = Field(None, description=_GRIPPER_STD)
    step_ns: int = Field(0, description=_STEP)


PROMPT = Topic(
    "/tis/prompt_estimates", PromptNote, stamps=("t_ns", "begin_ns"), samples=("sample_ns",), is_frequent=True
)


class PhaseNote(Message):
    """A change of the tick phase; mean ages are over the recent arrivals."""

    tick: int = Field(description="Last tick with the previous phase.")
    phase_ns: int = Field(description="Offset of the following ticks from the sample instants, in ns.")
    age_ns: int = Field(description="Mean age of the freshest sample at ticks of the new phase, in ns.")
    age_before_ns: int = Field(description="Mean age of the freshest sample at ticks of the previous phase, in ns.")


PHASES = Topic("/tis/tick_phases", PhaseNote)


class PlantNote(Message):
    """The arm of the plant at a tick."""

    tick: int = Field(description=_TICK)
    t_ns: int = Field(description="Nominal instant of the tick, in ns.")
    hand: Hand = Field(description=_HAND)
    position_m: Vector3 = Field(description="Position of the plant's arm, in m.")
    age_ns: int | None = Field(
        None, description="Age of an external arm's pose, counted from its arrival, in ns; null: a plant of ours."
    )
    clamped: bool = Field(False, description="True: the set point in force lies outside what the arm's joints reach.")


PLANT = Topic("/tis/plant", PlantNote, stamps=("t_ns",), is_frequent=True, is_recomputable=True)

Outcome = Literal["deliver", "loss", "outage", "refused", "overflow", "queue_full"]
"""Decision on a packet when it is offered. ``deliver``: it is held, or waits in the queue of a rate."""

Departure = Literal["released", "late", "codel", "evicted"]
"""Departure of a held packet: released, or dropped (overtaken, by CoDel, or by the policy of a full buffer)."""


class FateBatch(Message):
    """Decisions on packets of one key, column by column, in the order of offering."""

    direction: Direction = Field(description=_DIRECTION)
    key: str = Field(description=_KEY)
    foreign: bool = Field(False, description=_FOREIGN)
    seq: tuple[int, ...] = Field((), description="Sequence number of each packet.")
    offered_ns: tuple[int, ...] = Field((), description=_OFFERED)
    outcome: tuple[Outcome, ...] = Field(
        (),
        description="Decision: deliver, or dropped by a loss model (loss), by an outage, as no rule admits the key "
        "(refused), by a full buffer (overflow) or a full queue (queue_full).",
    )
    delay_ns: tuple[int, ...] = Field((), description="Delay drawn by the models, without queue and ordering, in ns.")
    release_ns: tuple[int, ...] = Field(
        (),
        description="Decided run time of the release, after ordering, in ns; 0 where the packet is dropped, or where "
        "a queue decides later (see the release batch).",
    )
    n_bytes: tuple[int, ...] = Field((), description="Size of the payload, in bytes.")
    copies: tuple[int, ...] = Field((), description="Number of copies that netem made, the original not counted.")
    flipped: tuple[int, ...] = Field((), description="Number of flipped payload bits.")


FATES = Topic("/tis/fates", FateBatch, is_frequent=True)


class ReleaseBatch(Message):
    """Departures of packets of one key from netem, column by column, in the order of departure."""

    direction: Direction = Field(description=_DIRECTION)
    key: str = Field(description=_KEY)
    foreign: bool = Field(False, description=_FOREIGN)
    seq: tuple[int, ...] = Field((), description="Sequence number of each packet.")
    copy_index: tuple[int, ...] = Field((), description="Number of the copy; 0: the original.")
    offered_ns: tuple[int, ...] = Field((), description=_OFFERED)
    release_ns: tuple[int, ...] = Field((), description="Decided run time of the release, in ns.")
    released_ns: tuple[int, ...] = Field(
        (), description="Measured run time of the release, in ns; 0 where the packet was dropped."
    )
    departure: tuple[Departure, ...] = Field(
        (),
        description="released, or the reason of the drop: overtaken (late), CoDel (codel), policy of a full buffer "
        "(evicted).",
    )
    queued_ns: tuple[int, ...] = Field((), description="Time in the queue of a rate, transmission included, in ns.")


RELEASES = Topic("/tis/releases", ReleaseBatch, is_frequent=True)


class QueueNote(Message):
    """The depth of a rate's queue, sampled when a packet is offered to it, at most every 10 ms of run time."""

    direction: Direction = Field(description=_DIRECTION)
    at_ns: int = Field(description="Run time of the sample, in ns.")
    n_packets: int = Field(description="Number of packets in the queue.")
    n_bytes: int = Field(description="Number of bytes in the queue, overhead included.")


QUEUES = Topic("/tis/queues", QueueNote)


class ControlNote(Message):
    """A request to change the network during the run, accepted or refused."""

    at_ns: int = Field(description="Run time of the request, in ns.")
    applied_ns: int = Field(description="Run time from which the change holds, in ns; 0 when refused.")
    operation: str = Field("set", description="set, outage, reset or profile; any text when refused.")
    request: str = Field(description="The request as JSON, truncated.")
    added: str = Field("", description="Resulting entries of the timeline, as a JSON list.")
    accepted: bool = Field(description="true: the change was made; false: it was refused.")
    reason: str = Field("", description="Reason for a refusal.")


CONTROL = Topic("/tis/control", ControlNote)

SENT_PACKETS = "sent_packets"
UNRECORDED = "unrecorded"
SENT_BYTES = "sent_bytes"


class CounterNote(Message):
    """A counter of a side at the end of the run."""

    name: str = Field(
        description="Name of the counter. The surgeon's traffic on a key is in sent_packets.KEY and sent_bytes.KEY, "
        "the failed steps of a user-defined estimator, over all hands, in faulty_steps.ESTIMATOR, the records that a "
        "log lacks since the disk was too slow in unrecorded.TOPIC."
    )
    value: int = Field(description="Final value.")


COUNTERS = Topic("/tis/counters", CounterNote)
