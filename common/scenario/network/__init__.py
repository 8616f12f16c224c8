"""What the network does to the messages that cross it. Every number is one way, per direction."""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, StringConstraints, field_validator

from common.key_expression import key_expression_fault
from common.scenario.base import Part
from common.scenario.network.conditions import BothOr, Outages, States, TimelineEntry
from common.scenario.network.pipeline import Pipeline


def _key_expression(value: str) -> str:
    fault = key_expression_fault(value)
    if fault is not None:
        raise ValueError(fault)
    return value


KeyExpression = Annotated[str, StringConstraints(min_length=1), AfterValidator(_key_expression)]


class Rule(Part):
    """A pipeline of its own for the keys that match; the most specific rule wins."""

    key: KeyExpression = Field(description="Zenoh key expression, like */MTML/measured_cp.")
    direction: BothOr = Field(description="forward: surgeon to patient (west to east); feedback: back; or both.")
    pipeline: Pipeline = Field(description="What happens to these messages; {}: they pass at once.")


class Buffer(Part):
    """What netem may hold in each direction, so that its memory is bounded."""

    max_packets: Annotated[int, Field(strict=True, ge=1, le=10_000_000)] = Field(
        200_000, description="Messages that may wait for their release."
    )
    max_mb: Annotated[float, Field(gt=0, le=1_000_000)] = Field(
        512.0, description="Payload and attachment bytes that may wait, in MB (10**6 bytes)."
    )
    policy: Literal["drop_newest", "drop_oldest"] = Field(
        "drop_newest", description="What goes when it is full: the message offered, or the one held longest."
    )


class NetworkPart(Part):
    """The emulated network between surgeon and patient."""

    profile: str | None = Field(
        None,
        description="A network of the profile library (tis net profiles); what is given beside it overrides it. "
        "In a scenario that has been loaded its values are filled in, and from_profile names it.",
    )
    from_profile: str | None = Field(
        None, description="The profile that the values were filled in from; a label, written by the software."
    )
    unmatched: Literal["refuse", "pass"] = Field(
        "refuse",
        description="Keys outside the session that no rule names: refused (counted) or passed clean.",
    )
    forward: Pipeline = Field(Pipeline(), description="Surgeon to patient, west to east.")
    feedback: Pipeline = Field(Pipeline(), description="Patient to surgeon, east to west.")
    rules: tuple[Rule, ...] = Field((), description="Exceptions by key and direction.")
    outages: tuple[Outages, ...] = Field((), description="Outages that come again and again.")
    states: States | None = Field(None, description="Conditions that drive delay, loss and rate together.")
    timeline: tuple[TimelineEntry, ...] = Field((), description="Changes while the run lasts.")
    buffer: Buffer = Field(Buffer(), description="How much netem may hold.")

    @field_validator("profile")
    @classmethod
    def _filled_in(cls, profile: str | None) -> None:
        """Refuse a name whose values nobody has filled in: the network would be another one."""
        if profile is not None:
            raise ValueError(
                "must have been filled in: the sides of `tis` do so, and `tis validate SCENARIO > FILE` writes a "
                "scenario that stands alone"
            )
