"""How much a link carries: serialisation at a bit rate, and the bounded queue before it."""

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from common.scenario.base import Part

Count = Annotated[int, Field(strict=True, ge=1, le=1_000_000_000)]
_BYTES = (
    "Bytes that may wait, the overhead of each message included, so a longer message never passes; no bound when "
    "not given."
)


class TailDrop(Part):
    """A message that finds the queue full is dropped."""

    kind: Literal["tail_drop"] = Field(description="tail_drop: what finds the queue full is dropped.")
    max_packets: Count = Field(1000, description="Messages that may wait, the one in transmission included.")
    max_bytes: Count | None = Field(None, description=_BYTES)


class CoDel(Part):
    """Controlled delay, RFC 8289: drops where the wait has stayed above a target for an interval.

    It is made for senders that slow down when they lose something. Where they do not, the wait stands above the
    target, the further the more they send.
    """

    kind: Literal["codel"] = Field(description="codel: RFC 8289; drops where the wait stays above a target.")
    target_ms: Annotated[float, Field(ge=0.001, le=60_000)] = Field(
        5.0, description="Wait that is acceptable, in ms."
    )
    interval_ms: Annotated[float, Field(ge=0.001, le=600_000)] = Field(
        100.0, description="How long it may be exceeded, in ms; 10 to 20 times the target, as the RFC has it."
    )
    max_packets: Count = Field(1000, description="Messages that may wait, the one in transmission included.")
    max_bytes: Count | None = Field(None, description=_BYTES)


class Rate(Part):
    """A bit rate that the keys of a link share: each message waits for those before it, then takes its time."""

    kbit_s: Annotated[float, Field(ge=0.001, le=1e9)] = Field(description="Bit rate, in kbit/s (1000 bit/s).")
    overhead_bytes: Annotated[int, Field(strict=True, ge=0, le=65_535)] = Field(
        0,
        description="Bytes that each message costs beside payload and attachment, like headers of the layers below.",
    )
    queue: Annotated[TailDrop | CoDel, Field(discriminator="kind")] = Field(
        TailDrop(kind="tail_drop", max_packets=1000, max_bytes=None), description="What waits for its transmission."
    )


def _rate_or_link(value: object) -> str | None:
    if isinstance(value, Mapping | Rate):
        return "Rate"
    return "link" if value == "link" else None


RateOrLink = Annotated[
    Annotated[Rate, Tag("Rate")] | Annotated[Literal["link"], Tag("link")],
    Discriminator(
        _rate_or_link,
        custom_error_type="in_words",
        custom_error_message="must be 'link' or {kbit_s: NUMBER, queue: ...}",
    ),
]
