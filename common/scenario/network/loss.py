"""Which messages are lost: independently, in bursts, or as recorded.

Addressed by sequence number; a trace, on request, by time.
"""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from common.scenario.base import Part, Probability

Segment = Annotated[int, Field(strict=True, ge=64, le=1_000_000)]
_LEAST: float = 1e-9  # rarer steps than that would never be seen
OpenProbability = Annotated[float, Field(ge=_LEAST, le=1)]


class _Loss(Part):
    """What all loss models share."""

    mtu_bytes: Segment | None = Field(
        None,
        description="Probabilities are those of packets of so many bytes of payload, a message is lost when one of "
        "its packets is; not given: those of whole messages.",
    )


class BernoulliLoss(_Loss):
    """Each message is lost with the same probability, independently of the others."""

    kind: Literal["bernoulli"] = Field(description="bernoulli: independent losses.")
    p_loss: Probability = Field(description="Probability that a message is lost, 0 to 1 (not per cent).")


class BurstLoss(_Loss):
    """Gilbert's model by what one measures: the mean share of losses and the mean length of a run of them.

    r = 1 / mean_burst, p = r p_loss / (1 - p_loss).
    """

    kind: Literal["burst"] = Field(description="burst: Gilbert's model by mean loss and mean burst length.")
    p_loss: Annotated[float, Field(gt=0, lt=1)] = Field(description="Mean share of messages lost, 0 to 1.")
    mean_burst: Annotated[float, Field(ge=1, le=2_000)] = Field(
        description="Mean number of messages in a run of losses; 1 / (1 - p_loss) are independent losses. "
        "What lasts longer is an outage."
    )

    @model_validator(mode="after")
    def _possible(self) -> Self:
        least = self.p_loss / (1 - self.p_loss)
        if self.mean_burst < least:
            raise ValueError(f"mean_burst must be at least p_loss / (1 - p_loss) = {least:.6g}")
        return self


class GilbertElliottLoss(_Loss):
    """Two states, good and bad, each with its own loss; the state may change with each message."""

    kind: Literal["gilbert_elliott"] = Field(description="gilbert_elliott: good and bad states by four parameters.")
    p_bad: OpenProbability = Field(description="Probability that good turns bad before a message (p).")
    p_good: OpenProbability = Field(description="Probability that bad turns good before a message (r).")
    p_loss_bad: Probability = Field(1.0, description="Share lost in the bad state (1 - h).")
    p_loss_good: Probability = Field(0.0, description="Share lost in the good state (1 - k).")


class FourStateLoss(_Loss):
    """Four states, as in tc-netem: 1 received, 2 received within a burst, 3 lost within a burst, 4 lost alone.

    Salsano, Ludovici, Ordine, Giannuzzi, "Definition of a general and intuitive loss model for packet networks".
    """

    kind: Literal["four_state"] = Field(description="four_state: the 4-state Markov model of tc-netem.")
    p13: Probability = Field(description="Begin of a burst.")
    p31: Probability = Field(description="End of a burst.")
    p32: Probability = Field(0.0, description="From lost to received within a burst.")
    p23: Probability = Field(1.0, description="From received to lost within a burst.")
    p14: Probability = Field(0.0, description="An isolated loss; the next message is received.")

    @model_validator(mode="after")
    def _rows_add_up(self) -> Self:
        faults = []
        if self.p13 + self.p14 > 1:
            faults.append("p13 + p14 must be at most 1")
        if self.p31 + self.p32 > 1:
            faults.append("p31 + p32 must be at most 1")
        if self.p31 < _LEAST and self.p13 > 0:
            faults.append(f"p31 must be at least {_LEAST:g}, or a burst never ends")
        if self.p23 < _LEAST and self.p32 > 0:
            faults.append(f"p23 must be at least {_LEAST:g} where p32 is greater than 0")
        if faults:
            raise ValueError("\n".join(faults))
        return self


class _Lomax(Part):
    """X of Pareto II (Lomax): P(X > x) = (1 + x / scale) ** -shape."""

    shape: Annotated[float, Field(gt=1, le=50)] = Field(description="Tail index, above 1 so that there is a mean.")
    scale: Annotated[float, Field(ge=0.001, le=1_000_000)] = Field(description="Scale, in messages.")


class ParetoRun(_Lomax):
    """A run length of 1 + floor(X), X of Pareto II (Lomax): P(X > x) = (1 + x / scale) ** -shape."""


class ParetoRunsLoss(_Loss):
    """Runs of received and of lost messages take turns, their lengths heavy-tailed."""

    kind: Literal["pareto_runs"] = Field(description="pareto_runs: heavy-tailed runs of received and lost messages.")
    received: ParetoRun = Field(description="Lengths of the runs that are received.")
    lost: ParetoRun = Field(description="Lengths of the runs that are lost.")


class ParetoBurst(_Lomax):
    """A number of losses of floor(X), often 0, X of Pareto II (Lomax): P(X > x) = (1 + x / scale) ** -shape."""


class GilbertParetoLoss(_Loss):
    """Good and bad states, in each of which bursts have heavy-tailed lengths of their own.

    After each message that gets through, a burst of floor(X) losses begins, often of none, X of the present state;
    the message after it gets through. The state may change with each message. It is the model of the telesurgery
    fault injector NetFI (ICRA 2026).
    """

    kind: Literal["gilbert_pareto"] = Field(
        description="gilbert_pareto: good and bad states, each with heavy-tailed bursts."
    )
    p_bad: OpenProbability = Field(description="Probability that good turns bad before a message.")
    p_good: OpenProbability = Field(description="Probability that bad turns good before a message.")
    good: ParetoBurst = Field(description="Lengths of the bursts that begin in the good state.")
    bad: ParetoBurst = Field(description="Lengths of the bursts that begin in the bad state.")


class TraceLoss(Part):
    """The losses of a recorded trace, one row after the other."""

    kind: Literal["trace"] = Field(description="trace: the losses of a recorded trace.")
    path: str = Field(min_length=1, description="CSV file, as tis net probe writes it.")
    advance: Literal["packet", "time"] = Field(
        "packet", description="packet: each message takes the next row; time: the row of its run time."
    )


Loss = Annotated[
    BernoulliLoss | BurstLoss | GilbertElliottLoss | FourStateLoss | ParetoRunsLoss | GilbertParetoLoss | TraceLoss,
    Field(discriminator="kind"),
]
