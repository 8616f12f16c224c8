"""Capacity of a link: serialisation at a bit rate, and the bounded queue in front of it."""

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from common.scenario.base import Part

Count = Annotated[int, Field(strict=True, ge=1, le=1_000_000_000)]
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


class Rate(Part):
    """A bit rate that the keys of a link share: each message waits for earlier ones, then for its transmission."""

    kbit_s: Annotated[float, Field(ge=0.001, le=1e9)] = Field(description="Bit rate, in kbit/s (1000 bit/s).")
    overhead_bytes: Annotated[int, Field(strict=True, ge=0, le=65_535)] = Field(
        0, description="Bytes per message beside payload and attachment, such as headers of lower layers."
    )
    queue: Annotated[TailDrop | CoDel, Field(discriminator="kind")] = Field(
        TailDrop(kind="tail_drop", max_packets=1000, max_bytes=None),
        description="Queue in front of the transmission.",
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
