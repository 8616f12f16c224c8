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


class FreshNote(Message):
    """The freshest command sample that a tick used: what end-to-end latency is computed from."""

    tick: int
    hand: Hand
    key: str
    seq: int
    sample_ns: int


FRESH = "/tis/fresh"


class PlantNote(Message):
    """Where the arm of the plant is at a tick."""

    tick: int
    t_ns: int
    hand: Hand
    position_m: Vector3


class FateNote(Message):
    """What netem decided for one packet when it was offered."""

    direction: Direction
    key: str
    seq: int
    offered_ns: int
    outcome: Literal["deliver", "loss", "outage", "refused", "overflow"]
    delay_ns: int = Field(0, description="Delay that the models drew.")
    release_ns: int = Field(0, description="Instant at which it is to leave, after ordering.")
    n_bytes: int = 0
    foreign: bool = Field(False, description="Its attachment is not ours; it was numbered here.")


class ReleaseNote(Message):
    """A packet left netem, or was found overtaken when it should have (``drop_late``)."""

    direction: Direction
    key: str
    seq: int
    offered_ns: int
    release_ns: int
    released_ns: int
    late: bool = False
    foreign: bool = False


SENT_PACKETS = "sent_packets"
SENT_BYTES = "sent_bytes"


class CounterNote(Message):
    """A side's counters by name, at the end of the run.

    The surgeon's traffic on a key is in ``sent_packets.KEY`` and ``sent_bytes.KEY``.
    """

    name: str
    value: int
