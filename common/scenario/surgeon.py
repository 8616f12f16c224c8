"""How the surgeon's side puts samples on the wire: how often each one goes out, and what rides along."""

from typing import Annotated

from pydantic import Field

from common.scenario.base import Part

Copies = Annotated[int, Field(strict=True, ge=1, le=64)]
History = Annotated[int, Field(strict=True, ge=0, le=256)]
CopySpacing = Annotated[float, Field(ge=0, le=60_000)]


class SurgeonPart(Part):
    """How the surgeon's side puts samples on the wire."""

    copies: Copies = Field(
        1, description="How often each sample is sent, each time as a packet of its own with a fate of its own."
    )
    copy_spacing_ms: CopySpacing = Field(
        0.0,
        description="Time between the copies of a sample, in ms; 0: all at once, which is best where packets are "
        "delayed independently. Where delays hang together, copies spread over the sample period meet different "
        "moments of the network; further apart newer samples overtake them.",
    )
    history: History = Field(0, description="How many of the samples before it ride in each packet.")
