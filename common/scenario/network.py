"""What the network does to the messages that cross it. Every number is one way, per direction."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from common.channels import Direction
from common.scenario.base import Milliseconds, NonNegative, Part, Positive, Probability


class ConstantDelay(Part):
    """Every message is equally late."""

    kind: Literal["constant"] = Field(description="constant: the same delay for every message.")
    delay_ms: Milliseconds = Field(description="One-way delay, in ms.")


class UniformDelay(Part):
    """Delays are equally likely between two bounds."""

    kind: Literal["uniform"] = Field(description="uniform: between two bounds.")
    low_ms: Milliseconds = Field(description="Smallest one-way delay, in ms.")
    high_ms: Milliseconds = Field(description="Largest one-way delay, in ms.")

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.high_ms < self.low_ms:
            raise ValueError(f"high_ms must be at least low_ms = {self.low_ms}")
        return self


class NormalDelay(Part):
    """Normally distributed delays; negative ones are redrawn (the distribution is truncated at 0)."""

    kind: Literal["normal"] = Field(description="normal: mean and standard deviation.")
    mean_ms: Milliseconds = Field(description="Mean of the normal distribution before truncation, in ms.")
    std_ms: Milliseconds = Field(description="Its standard deviation, in ms.")


class NormalJitter(Part):
    """A normal deviation added to the delay; redrawn where the sum would be negative."""

    kind: Literal["normal"] = Field(description="normal: a standard deviation about the delay.")
    std_ms: Milliseconds = Field(description="Standard deviation, in ms.")


class UniformJitter(Part):
    """A uniform deviation added to the delay; redrawn where the sum would be negative."""

    kind: Literal["uniform"] = Field(description="uniform: within plus and minus a half width.")
    half_width_ms: Milliseconds = Field(description="The deviation lies within plus and minus this, in ms.")


class BernoulliLoss(Part):
    """Each message is lost with the same probability, independently of the others."""

    kind: Literal["bernoulli"] = Field(description="bernoulli: independent losses.")
    p_loss: Probability = Field(description="Probability that a message is lost, 0 to 1 (not per cent).")


Delay = Annotated[ConstantDelay | UniformDelay | NormalDelay, Field(discriminator="kind")]
Jitter = Annotated[NormalJitter | UniformJitter, Field(discriminator="kind")]
Loss = Annotated[BernoulliLoss, Field(discriminator="kind")]


class Pipeline(Part):
    """What happens to a message, in this order: loss, delay plus jitter, ordering. Empty: nothing."""

    loss: Loss | None = Field(None, description="Which messages are lost.")
    delay: Delay | None = Field(None, description="How late a message is; none: not at all.")
    jitter: Jitter | None = Field(None, description="A deviation added to each delay.")
    ordering: Literal["fifo", "reorder", "drop_late"] = Field(
        "fifo",
        description="When a message would overtake an earlier one of its key: it waits (fifo), it overtakes "
        "(reorder), or the overtaken one is dropped (drop_late).",
    )

    @model_validator(mode="after")
    def _jitter_has_a_delay(self) -> Self:
        if self.jitter is not None and self.delay is None:
            raise ValueError("jitter needs a delay to deviate from")
        return self


class Rule(Part):
    """A pipeline of its own for the keys that match; the most specific rule wins."""

    key: str = Field(min_length=1, description="Zenoh key expression, like */MTML/measured_cp.")
    direction: Direction = Field(description="forward: surgeon to patient; feedback: back.")
    pipeline: Pipeline = Field(description="What happens to these messages; {}: they pass at once.")


class TimelineSet(Part):
    """What a timeline entry switches."""

    outage: Literal[True] = Field(description="While it holds, every message that is offered is lost.")


class TimelineEntry(Part):
    """A change at a moment of run time, on a grid of 1 ms; messages in flight are not touched."""

    at_s: NonNegative = Field(description="When it begins, in s of run time.")
    for_s: Positive = Field(description="How long it holds, in s.")
    direction: Literal[Direction, "both"] = Field("both", description="Which direction it applies to.")
    set: TimelineSet = Field(description="What holds meanwhile.")


class NetworkPart(Part):
    """The emulated network between surgeon and patient."""

    unmatched: Literal["refuse", "pass"] = Field(
        "refuse",
        description="Keys outside the session that no rule names: refused (counted) or passed clean.",
    )
    forward: Pipeline = Field(Pipeline(), description="Surgeon to patient.")
    feedback: Pipeline = Field(Pipeline(), description="Patient to surgeon.")
    rules: tuple[Rule, ...] = Field((), description="Exceptions by key and direction.")
    timeline: tuple[TimelineEntry, ...] = Field((), description="Changes while the run lasts.")
