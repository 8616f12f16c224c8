"""Capacity of a link: a bit rate or a recording of one, the queue in front of it, and the other users' traffic."""

from collections.abc import Mapping
from typing import Annotated, Final, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator

from tis.common.scenario.base import Part

MAX_COUNT: Final = 1_000_000_000
"""The largest number of messages in a queue: more than any run has, so it is no bound."""

Count = Annotated[int, Field(strict=True, ge=1, le=MAX_COUNT)]
_BYTES = (
    "Maximum number of waiting bytes, the overhead of each message included; a longer message never passes. Not "
    "given: no bound."
)
_PACKETS = "Maximum number of waiting messages, the one in transmission included."


class TailDrop(Part):
    """A queue that drops each message that arrives while it is full."""

    kind: Literal["tail_drop"] = Field(description="tail_drop: a message that finds the queue full is dropped.")
    max_packets: Count = Field(1000, description=_PACKETS)
    max_bytes: Count | None = Field(None, description=_BYTES)


class CoDel(Part):
    """Controlled delay, RFC 8289: drops messages while the wait has been above a target for an interval.

    CoDel relies on senders that slow down after a loss. With senders that do not, the wait stays above the target,
    the more so the higher their rate.
    """

    kind: Literal["codel"] = Field(description="codel: drops while the wait exceeds a target (RFC 8289).")
    target_ms: Annotated[float, Field(ge=0.001, le=60_000)] = Field(5.0, description="Acceptable wait, in ms.")
    interval_ms: Annotated[float, Field(ge=0.001, le=600_000)] = Field(
        100.0, description="Time for which the wait may exceed the target, in ms; the RFC advises 10 to 20 times it."
    )
    max_packets: Count = Field(1000, description=_PACKETS)
    max_bytes: Count | None = Field(None, description=_BYTES)


class PriorityQueue(Part):
    """One line for each of Zenoh's priorities: the next message is the oldest one of the highest priority.

    A message that finds the queue full takes the place of the newest ones of the lowest priority below its own; where
    there are none it is dropped. A transmission is not interrupted.
    """

    kind: Literal["priority"] = Field(
        description="priority: the message of the highest Zenoh priority goes first; a full queue drops the newest "
        "of the lowest."
    )
    max_packets: Count = Field(1000, description=_PACKETS)
    max_bytes: Count | None = Field(None, description=_BYTES)


_MAX_PER_S: Final = 50_000


class _Cross(Part):
    """Traffic of others, in messages of one length."""

    kbit_s: Annotated[float, Field(ge=0.001, le=1e7)] = Field(description="Bit rate offered, in kbit/s.")
    message_bytes: Annotated[int, Field(strict=True, ge=1, le=65_535)] = Field(
        1500, description="Length of each message, its headers included."
    )

    @property
    def per_s(self) -> float:
        """Return the messages per s while they come."""
        return self.kbit_s * 125 / self.message_bytes

    @model_validator(mode="after")
    def _affordable(self) -> Self:
        if self.per_s > _MAX_PER_S:
            raise ValueError(f"must be at most {_MAX_PER_S} messages per s: give longer messages")
        return self


class ConstantCross(_Cross):
    """Messages at equal intervals."""

    kind: Literal["constant"] = Field(description="constant: messages at equal intervals.")


class OnOffCross(_Cross):
    """Messages at equal intervals while the source is on; on and off times are exponential."""

    kind: Literal["on_off"] = Field(description="on_off: messages at equal intervals, at times.")
    mean_on_s: Annotated[float, Field(ge=0.001, le=86_400)] = Field(description="Mean time on, in s.")
    mean_off_s: Annotated[float, Field(ge=0.001, le=86_400)] = Field(description="Mean time off, in s.")


class PoissonCross(_Cross):
    """Messages at exponential intervals."""

    kind: Literal["poisson"] = Field(description="poisson: messages at exponential intervals.")


Cross = Annotated[ConstantCross | OnOffCross | PoissonCross, Field(discriminator="kind")]


Queue = Annotated[
    TailDrop | CoDel | PriorityQueue, Field(discriminator="kind", description="Queue in front of the transmission.")
]
_Overhead = Annotated[
    int,
    Field(
        strict=True,
        ge=0,
        le=65_535,
        description="Bytes per message beside payload and attachment, such as headers of lower layers.",
    ),
]
_CrossOrNone = Annotated[
    Cross | None, Field(description="Messages of others, which wait in the same queue; not given: there are none.")
]
_Backpressure = Annotated[
    bool,
    Field(
        description="Whether netem stops reading a sender's connection while the queue is full, so that the sender's "
        "own congestion control (DROP, BLOCK, BLOCK_FIRST) acts. Live only."
    ),
]
_QUEUE: Final = TailDrop(kind="tail_drop", max_packets=1000, max_bytes=None)


class Rate(Part):
    """A bit rate that the keys of a link share: each message waits for earlier ones, then for its transmission."""

    kbit_s: Annotated[float, Field(ge=0.001, le=1e9)] = Field(description="Bit rate, in kbit/s (1000 bit/s).")
    overhead_bytes: _Overhead = 0
    queue: Queue = _QUEUE
    cross: _CrossOrNone = None
    backpressure: _Backpressure = False


class RecordedRate(Part):
    """Recorded opportunities to send, as mahimahi has them; from its end on the recording repeats."""

    opportunities: str = Field(
        min_length=1,
        description="File of mahimahi: a line for each opportunity, its time from the run's begin in whole ms.",
    )
    opportunity_bytes: Annotated[int, Field(strict=True, ge=1, le=65_535)] = Field(
        1500, description="Bytes that one opportunity sends, of one message or several."
    )
    overhead_bytes: _Overhead = 0
    queue: Queue = _QUEUE
    cross: _CrossOrNone = None
    backpressure: _Backpressure = False


Capacity = Rate | RecordedRate


def _rate_or_link(value: object) -> str | None:
    if isinstance(value, RecordedRate) or (isinstance(value, Mapping) and "opportunities" in value):
        return "RecordedRate"
    if isinstance(value, Mapping | Rate):
        return "Rate"
    return "link" if value == "link" else None


RateOrLink = Annotated[
    Annotated[Rate, Tag("Rate")]
    | Annotated[RecordedRate, Tag("RecordedRate")]
    | Annotated[Literal["link"], Tag("link")],
    Discriminator(
        _rate_or_link,
        custom_error_type="in_words",
        custom_error_message="must be 'link', {kbit_s: NUMBER, queue: ...} or {opportunities: FILE, queue: ...}",
    ),
]
