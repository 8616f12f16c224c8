"""The pipeline of one direction: the stages that every message passes."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from tis.common.scenario.base import Milliseconds, Part, Probability, refuse
from tis.common.scenario.network.capacity import RateOrLink
from tis.common.scenario.network.delay import Correlation, Delay, Jitter
from tis.common.scenario.network.loss import Loss, Recovery

Ordering = Literal["fifo", "reorder", "drop_late"]


class Duplicate(Part):
    """Duplication of messages; the copy draws its own delay."""

    p_duplicate: Probability = Field(description="Probability that a message is duplicated, 0 to 1.")


class Corrupt(Part):
    """Bit errors in the payload; key and attachment stay intact."""

    p_corrupt: Probability = Field(description="Probability that a message is corrupted, 0 to 1.")
    bits: Annotated[int, Field(strict=True, ge=1, le=1000)] = Field(
        1, description="Number of bits that flip in a corrupted message."
    )


class Reorder(Part):
    """Messages that skip their delay and so overtake others; needs ``ordering: reorder``."""

    p_reorder: Probability = Field(description="Probability that a message skips its delay, 0 to 1.")
    early_ms: Milliseconds | None = Field(
        None, description="Part of the delay that the message skips, in ms; not given: the whole delay."
    )


class Stages(Part):
    """The stages that a pipeline has and a change may replace."""

    loss: Loss | None = Field(None, description="Loss of messages; not given: none are lost.")
    duplicate: Duplicate | None = Field(None, description="Duplication of messages; not given: none.")
    corrupt: Corrupt | None = Field(None, description="Bit errors in payloads; not given: none.")
    rate: RateOrLink | None = Field(
        None,
        description="Bit rate and queue, shared by the keys of this pipeline; link: those of the direction's own "
        "pipeline are shared; not given: no limit.",
    )
    delay: Delay | None = Field(None, description="One-way delay of messages; not given: none.")
    jitter: Jitter | None = Field(None, description="Random deviation added to each delay; not given: none.")
    correlation: Correlation | None = Field(
        None, description="Correlation of delay and jitter in time; not given: they are independent."
    )
    reorder: Reorder | None = Field(None, description="Messages that skip their delay; not given: none.")

    @property
    def recovery(self) -> Recovery | None:
        """Return the recovery of lost messages."""
        return None if self.loss is None else self.loss.recovery


def against_recovery(stages: Stages, ordering: Ordering | None) -> list[str]:
    """Return the rules that stages break beside a recovery of lost messages."""
    why = {
        "duplicate": "a reliable transport delivers once",
        "corrupt": "a reliable transport repeats what is damaged",
        "reorder": "a reliable transport delivers in order",
        "rate": "what a full queue drops is not repeated",
    }
    found = [f"{name} and loss.recovery exclude each other: {why[name]}" for name in why if getattr(stages, name)]
    if ordering not in (None, "fifo"):
        found.append("loss.recovery needs ordering: fifo")
    return found


class Pipeline(Stages):
    """Stages in the order of their effect: loss, duplicate, corrupt, rate, delay plus jitter, ordering.

    An empty pipeline changes nothing.
    """

    ordering: Ordering = Field(
        "fifo",
        description="Treatment of a message that would overtake an earlier one of its key. fifo: it waits; reorder: "
        "it overtakes; drop_late: the overtaken message is dropped.",
    )

    @property
    def is_open(self) -> bool:
        """Tell whether every message passes immediately: there are no stages, and late messages are not dropped."""
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
        faults = [rule for rule, holds in rules.items() if not holds]
        if self.recovery is not None:
            faults += against_recovery(self, self.ordering)
        refuse(faults)
        return self
