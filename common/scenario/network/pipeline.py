"""What happens to one message in one direction, stage by stage."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from common.scenario.base import Milliseconds, Part, Probability
from common.scenario.network.capacity import RateOrLink
from common.scenario.network.delay import Correlation, Delay, Jitter
from common.scenario.network.loss import Loss

Ordering = Literal["fifo", "reorder", "drop_late"]


class Duplicate(Part):
    """A message may come twice; the copy has a delay of its own."""

    p_duplicate: Probability = Field(description="Probability that a message comes twice, 0 to 1.")


class Corrupt(Part):
    """Bits of the payload may flip; key and attachment stay whole."""

    p_corrupt: Probability = Field(description="Probability that a message is corrupted, 0 to 1.")
    bits: Annotated[int, Field(strict=True, ge=1, le=1000)] = Field(1, description="Bits that flip in it.")


class Reorder(Part):
    """Some messages skip the delay and so overtake others; needs ``ordering: reorder``."""

    p_reorder: Probability = Field(description="Probability that a message skips the delay, 0 to 1.")
    early_ms: Milliseconds | None = Field(
        None, description="How much of its delay it skips, in ms; not given: all of it."
    )


class Stages(Part):
    """The stages that a pipeline has and a change may replace."""

    loss: Loss | None = Field(None, description="Which messages are lost.")
    duplicate: Duplicate | None = Field(None, description="Which messages come twice.")
    corrupt: Corrupt | None = Field(None, description="Which messages have bits flipped.")
    rate: RateOrLink | None = Field(
        None,
        description="Bit rate and queue, shared by the keys that have this pipeline; link: share that of the "
        "direction's own pipeline; none: no limit.",
    )
    delay: Delay | None = Field(None, description="How late a message is; none: not at all.")
    jitter: Jitter | None = Field(None, description="A deviation added to each delay.")
    correlation: Correlation | None = Field(
        None, description="How delay and jitter hang together in time; none: independent."
    )
    reorder: Reorder | None = Field(None, description="Which messages skip the delay.")


class Pipeline(Stages):
    """What happens to a message, in this order: loss, duplicate, corrupt, rate, delay plus jitter, ordering.

    Empty: nothing.
    """

    ordering: Ordering = Field(
        "fifo",
        description="When a message would overtake an earlier one of its key: it waits (fifo), it overtakes "
        "(reorder), or the overtaken one is dropped (drop_late).",
    )

    @property
    def is_open(self) -> bool:
        """Tell whether it lets every message pass at once: it has no stages, and drops none that comes late."""
        return (
            not any(getattr(self, stage) is not None for stage in Stages.model_fields)
            and self.ordering != "drop_late"
        )

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        rules = {
            "jitter needs a delay to deviate from": self.jitter is None or self.delay is not None,
            "correlation needs a delay": self.correlation is None or self.delay is not None,
            "correlation and a trace exclude each other: a trace has its own": (
                self.correlation is None or self.delay is None or self.delay.kind != "trace"
            ),
            "reorder needs a delay": self.reorder is None or self.delay is not None,
            "reorder needs ordering: reorder": self.reorder is None or self.ordering == "reorder",
        }
        broken = [rule for rule, holds in rules.items() if not holds]
        if broken:
            raise ValueError("\n".join(broken))
        return self
