"""What each side logs beside the messages themselves. Flat models: viewers refuse references and free-form maps."""

from typing import Literal

from pydantic import Field

from common.channels import Direction, Hand
from common.messages import Message, Vector3

REJECTED = "/tis/rejected"
TRUTH = "/tis/truth"
TICKS = "/tis/ticks"
ESTIMATES = "/tis/estimates"
PLANT = "/tis/plant"
FATES = "/tis/fates"
RELEASES = "/tis/releases"
QUEUES = "/tis/queues"
CONTROL = "/tis/control"
COUNTERS = "/tis/counters"


class Rejected(Message):
    """A message on one of our keys that is not ours, or is damaged. Counted; the run goes on."""

    key: str
    recv_ns: int
    reason: str
    head_hex: str = Field(max_length=64)


class TruthRow(Message):
    """Where the recorded arm was at one sample instant: for scoring only, never sent."""

    hand: Hand
    index: int
    sample_ns: int
    position_m: Vector3
    rotation_rad: Vector3 | None = Field(None, description="Its orientation as a rotation vector: axis times angle.")


class TickNote(Message):
    """A tick of this side: begun at ``begin_ns``, or missed (then ``begin_ns`` is when that was noticed)."""

    tick: int
    due_ns: int
    begin_ns: int
    missed: bool = False


class EstimateNote(Message):
    """One estimator's answer at one tick, for one hand; without ``position_m`` it had none yet."""

    tick: int
    t_ns: int
    hand: Hand
    estimator: str
    position_m: Vector3 | None
    std_m: Vector3 | None = None
    step_ns: int = 0


class EstimatorFault(Message):
    """The first time that a user's own estimator failed, for one hand; how often it did is counted."""

    t_ns: int
    hand: Hand
    estimator: str
    reason: str


ESTIMATOR_FAULTS = "/tis/estimator_faults"
FAULTY_STEPS = "faulty_steps"


class FreshNote(Message):
    """The freshest command sample that a tick used: what end-to-end latency is computed from."""

    tick: int
    hand: Hand
    key: str
    seq: int
    sample_ns: int
    answer: int | None = Field(None, description="Sequence number of the tick's answer, where it is not the tick's.")


FRESH = "/tis/fresh"


class PromptNote(Message):
    """An estimate made when a fresher sample arrived, between ticks: the active estimator's, for one hand.

    ``t_ns`` is the instant it is for, the arrival; ``key`` and ``seq`` name the packet that brought the sample;
    ``answer`` is the sequence number under which it was published, None where there was no estimate.
    """

    t_ns: int
    begin_ns: int
    hand: Hand
    estimator: str
    key: str
    seq: int
    sample_ns: int
    answer: int | None
    position_m: Vector3 | None
    std_m: Vector3 | None = None
    step_ns: int = 0


PROMPT = "/tis/prompt_estimates"


class PhaseNote(Message):
    """The ticks after ``tick`` lie ``phase_ns`` behind the sample instants; mean ages are over the arrivals seen."""

    tick: int
    phase_ns: int
    age_ns: int
    age_before_ns: int


PHASES = "/tis/tick_phases"


class PlantNote(Message):
    """Where the arm of the plant is at a tick."""

    tick: int
    t_ns: int
    hand: Hand
    position_m: Vector3


Outcome = Literal["deliver", "loss", "outage", "refused", "overflow", "queue_full"]
"""What is decided when a packet is offered. ``deliver``: it is held, or waits in the queue of a rate."""

Departure = Literal["released", "late", "codel", "evicted"]
"""How a packet that was held left: out, or dropped after all (overtaken, by CoDel, or by a full buffer's policy)."""


class FateBatch(Message):
    """What was decided for packets of one key, column by column, in the order of offering.

    ``foreign``: their attachment is not ours, so they were numbered here. ``release_ns`` is 0 where nothing is
    delivered and where a queue has still to say (then the release batch has it).
    """

    direction: Direction
    key: str
    foreign: bool = False
    seq: tuple[int, ...] = ()
    offered_ns: tuple[int, ...] = ()
    outcome: tuple[Outcome, ...] = ()
    delay_ns: tuple[int, ...] = Field((), description="Delay that the models drew; without queue and ordering.")
    release_ns: tuple[int, ...] = Field((), description="Instant at which it is to leave, after ordering.")
    n_bytes: tuple[int, ...] = Field((), description="Payload bytes.")
    copies: tuple[int, ...] = Field((), description="Copies beside the original.")
    flipped: tuple[int, ...] = Field((), description="Bits of the payload that were flipped.")


class ReleaseBatch(Message):
    """How packets of one key left netem, column by column, in the order of leaving.

    ``copy_index``: 0 for the original. ``release_ns`` is the decided instant, ``released_ns`` the real one, 0
    where the packet was dropped after all.
    """

    direction: Direction
    key: str
    foreign: bool = False
    seq: tuple[int, ...] = ()
    copy_index: tuple[int, ...] = ()
    offered_ns: tuple[int, ...] = ()
    release_ns: tuple[int, ...] = ()
    released_ns: tuple[int, ...] = ()
    departure: tuple[Departure, ...] = ()
    queued_ns: tuple[int, ...] = Field((), description="Time spent in the queue of a rate, transmission included.")


class QueueNote(Message):
    """The depth of a rate's queue, sampled when a packet is offered to it, at most every 10 ms of run time."""

    direction: Direction
    at_ns: int
    n_packets: int
    n_bytes: int


class ControlNote(Message):
    """A change made while the run lasted, or one that was refused."""

    at_ns: int
    applied_ns: int = Field(description="Run time of the grid's cell from which it holds; 0 when refused.")
    operation: str = Field("set", description="set, outage, reset or profile; whatever was asked when refused.")
    request: str = Field(description="The request as JSON, shortened.")
    added: str = Field("", description="The entries of the timeline that it became, as a JSON list.")
    accepted: bool
    reason: str = ""


SENT_PACKETS = "sent_packets"
SENT_BYTES = "sent_bytes"


class CounterNote(Message):
    """A side's counters by name, at the end of the run.

    The surgeon's traffic on a key is in ``sent_packets.KEY`` and ``sent_bytes.KEY``, the steps in which a user's own
    estimator failed, of all hands, in ``faulty_steps.ESTIMATOR``.
    """

    name: str
    value: int


CLOCK = "/tis/clock"


class ClockNote(Message):
    """How a side's clock stands to netem's, the reference, when the run begins. Equal ``boot_id``: one clock.

    Epochs are what the two monotonic clocks show at run time 0, as the side then knew it.
    """

    boot_id: str
    reference_boot_id: str
    shared: bool
    epoch_ns: int
    reference_epoch_ns: int


EXCHANGES = "/tis/clock_exchanges"


class ExchangeNote(Message):
    """One exchange of four timestamps: asked and answered in this side's run time, the rest in netem's.

    The first ones were made before the epoch, so their stamps are negative.
    """

    asked_ns: int
    received_ns: int
    replied_ns: int
    answered_ns: int


DISCIPLINE = "/tis/clock_discipline"


class DisciplineNote(Message):
    """What this host's kernel says of its clock (adjtimex): whether a time service keeps it, and how well."""

    at_ns: int
    synchronised: bool
    estimated_error_us: int
    maximum_error_us: int
    frequency_ppm: float = Field(description="Correction of the rate that the kernel applies.")


PROCESSORS = "/tis/processors"


class ProcessorNote(Message):
    """Who had the processors that a side may use, from ``from_ns`` to ``to_ns``, added up over these processors.

    None is not known, which is not 0: there is no /proc/stat, or no steal is counted, or no quota is known of.
    """

    from_ns: int
    to_ns: int
    processors: str = Field(description="Numbers of those that it may use, as 0-3,6.")
    own_ns: int = Field(description="Time on a processor of this process, of all its threads.")
    busy_ns: int | None = Field(None, description="Any program ran, this one too.")
    idle_ns: int | None = Field(None, description="None had anything to do.")
    iowait_ns: int | None = Field(None, description="Idle, while a disk was waited for.")
    steal_ns: int | None = Field(None, description="Taken by this virtual machine's host from who wanted to run.")
    quota_processors: float | None = Field(None, description="So many processors' time its control group may use.")
    n_periods: int | None = Field(None, description="Periods of that quota in which the group ran.")
    n_throttled: int | None = Field(None, description="Of these, those in which it was held back.")
    throttled_ns: int | None = Field(None, description="Time that it was held back, added up over processors.")
