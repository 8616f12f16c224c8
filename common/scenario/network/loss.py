"""Loss of messages: independent, in bursts, or as recorded.

Losses are addressed by sequence number; those of a trace, optionally, by time.
"""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from tis.common.scenario.base import Advance, Milliseconds, Part, Probability, TraceFile, refuse

Segment = Annotated[int, Field(strict=True, ge=64, le=1_000_000)]
_MIN_P: float = 1e-9  # rarer transitions would not occur in any run
_ROUNDING: float = 1e-12
OpenProbability = Annotated[float, Field(ge=_MIN_P, le=1)]


class Recovery(Part):
    """Repeats of lost messages by a reliable transport: none is lost, but it and all behind it arrive later.

    Linux's TCP: RACK and tail loss probe (RFC 8985), retransmission timeout with doubling (RFC 6298). All keys of a
    direction that have a recovery share one connection, and its congestion window.
    """

    rto_ms: Annotated[float, Field(ge=1, le=60_000)] = Field(
        200.0, description="Retransmission timeout above the round trip, in ms; Linux has at least 200."
    )
    rtt_ms: Milliseconds | None = Field(
        None, description="Round trip that the sender measures, in ms; not given: twice the pipeline's mean delay."
    )
    tail_probe: bool = Field(True, description="true: the last packet is repeated early, two round trips after it.")
    max_ms: Annotated[float, Field(ge=1, le=3_600_000)] = Field(
        120_000.0, description="Longest retransmission timeout after doubling, in ms."
    )
    congestion: Literal["cubic", "reno", "none"] = Field(
        "cubic",
        description="Congestion window: cubic (Linux's default) or reno; beyond it messages wait and leave in full "
        "segments. none: all are sent at once.",
    )


class _Recovered(Part):
    """Base of all loss models: what becomes of what they lose."""

    recovery: Recovery | None = Field(
        None,
        description="Repeats by a reliable transport, for all losses of the pipeline, outages included; not given: "
        "lost messages never arrive.",
    )


class _Loss(_Recovered):
    """Base of the loss models."""

    mtu_bytes: Segment | None = Field(
        None,
        description="Payload size of a packet, in bytes: probabilities and bursts apply to packets, and a message is "
        "lost when one of its packets is. Packets are counted as if all messages of a key had this one's size. Not "
        "given: probabilities and bursts apply to whole messages.",
    )


class BernoulliLoss(_Loss):
    """Independent losses of equal probability."""

    kind: Literal["bernoulli"] = Field(description="bernoulli: independent losses.")
    p_loss: Probability = Field(description="Probability that a message is lost, 0 to 1 (not per cent).")


class BurstLoss(_Loss):
    """Gilbert's model by measurable quantities: the share of losses and the mean length of a burst.

    r = 1 / mean_burst, p = r p_loss / (1 - p_loss).
    """

    kind: Literal["burst"] = Field(description="burst: Gilbert's model by mean loss and mean burst length.")
    p_loss: Annotated[float, Field(ge=0, lt=1)] = Field(description="Share of messages lost, 0 to 1.")
    mean_burst: Annotated[float, Field(ge=1, le=2_000)] = Field(
        description="Mean number of consecutive losses; 1 / (1 - p_loss) gives independent losses. For longer "
        "interruptions use outages."
    )

    @model_validator(mode="after")
    def _possible(self) -> Self:
        least = self.p_loss / (1 - self.p_loss)
        if self.mean_burst < least * (1 - _ROUNDING):  # .9 / (1 - .9) is above 9 in binary fractions
            raise ValueError(f"mean_burst must be at least p_loss / (1 - p_loss) = {least:.6g}")
        return self


class GilbertElliottLoss(_Loss):
    """Two states, good and bad, each with its own share of losses; the state may change with each message."""

    kind: Literal["gilbert_elliott"] = Field(description="gilbert_elliott: good and bad states by four parameters.")
    p_bad: OpenProbability = Field(description="Probability per message of the transition from good to bad (p).")
    p_good: OpenProbability = Field(description="Probability per message of the transition from bad to good (r).")
    p_loss_bad: Probability = Field(1.0, description="Probability of loss in the bad state, 0 to 1 (1 - h).")
    p_loss_good: Probability = Field(0.0, description="Probability of loss in the good state, 0 to 1 (1 - k).")


class FourStateLoss(_Loss):
    """Four states, as in tc-netem: 1 received, 2 received within a burst, 3 lost within a burst, 4 lost alone.

    Salsano, Ludovici, Ordine, Giannuzzi, "Definition of a general and intuitive loss model for packet networks".
    """

    kind: Literal["four_state"] = Field(description="four_state: the 4-state Markov model of tc-netem.")
    p13: Probability = Field(description="Probability per message that a burst begins (state 1 to 3).")
    p31: Probability = Field(description="Probability per message that the burst ends (state 3 to 1).")
    p32: Probability = Field(0.0, description="Probability, within a burst, of received after lost (state 3 to 2).")
    p23: Probability = Field(1.0, description="Probability, within a burst, of lost after received (state 2 to 3).")
    p14: Probability = Field(0.0, description="Probability per message of an isolated loss (state 1 to 4).")

    @model_validator(mode="after")
    def _rows_add_up(self) -> Self:
        faults = []
        if self.p13 + self.p14 > 1:
            faults.append("p13 + p14 must be at most 1")
        if self.p31 + self.p32 > 1:
            faults.append("p31 + p32 must be at most 1")
        if self.p31 < _MIN_P and self.p13 > 0:
            faults.append(f"p31 must be at least {_MIN_P:g}, or a burst never ends")
        if self.p23 < _MIN_P and self.p32 > 0:
            faults.append(f"p23 must be at least {_MIN_P:g} where p32 is greater than 0")
        refuse(faults)
        return self


class _Lomax(Part):
    """X of Pareto II (Lomax): P(X > x) = (1 + x / scale) ** -shape."""

    shape: Annotated[float, Field(gt=1, le=50)] = Field(description="Tail index, above 1 so that the mean is finite.")
    scale: Annotated[float, Field(ge=0.001, le=1_000_000)] = Field(description="Scale of X, in messages.")


class ParetoRun(_Lomax):
    """A run length of 1 + floor(X), X of Pareto II (Lomax): P(X > x) = (1 + x / scale) ** -shape."""


class ParetoRunsLoss(_Loss):
    """Alternating runs of received and lost messages, of heavy-tailed lengths."""

    kind: Literal["pareto_runs"] = Field(description="pareto_runs: heavy-tailed runs of received and lost messages.")
    received: ParetoRun = Field(description="Distribution of the lengths of received runs.")
    lost: ParetoRun = Field(description="Distribution of the lengths of lost runs.")


class ParetoBurst(_Lomax):
    """A burst of floor(X) losses, often 0, X of Pareto II (Lomax): P(X > x) = (1 + x / scale) ** -shape."""


class GilbertParetoLoss(_Loss):
    """Good and bad states, each with its own heavy-tailed burst lengths.

    After each delivered message a burst of floor(X) losses follows, often of length 0, X drawn for the present state;
    the message after it is delivered. The state may change with each message. It is the model of the telesurgery
    fault injector NetFI (ICRA 2026).
    """

    kind: Literal["gilbert_pareto"] = Field(
        description="gilbert_pareto: good and bad states, each with heavy-tailed bursts."
    )
    p_bad: OpenProbability = Field(description="Probability per message of the transition from good to bad.")
    p_good: OpenProbability = Field(description="Probability per message of the transition from bad to good.")
    good: ParetoBurst = Field(description="Distribution of the lengths of bursts that begin in the good state.")
    bad: ParetoBurst = Field(description="Distribution of the lengths of bursts that begin in the bad state.")


class TraceLoss(_Recovered):
    """The losses of a recorded trace, row by row."""

    kind: Literal["trace"] = Field(description="trace: the losses of a recorded trace.")
    path: TraceFile
    advance: Advance = "packet"


Loss = Annotated[
    BernoulliLoss | BurstLoss | GilbertElliottLoss | FourStateLoss | ParetoRunsLoss | GilbertParetoLoss | TraceLoss,
    Field(discriminator="kind"),
]
