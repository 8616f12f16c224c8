"""Changes of the network during a run: outages, steps of the delay, joint states of several stages, and a timeline.

All of them act in run time, on a grid of 1 ms, on all keys of a direction together. They apply to messages that are
offered while they hold; messages in flight are unaffected, but a rate holds from its instant on for all that waits.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

from tis.common.channels import Direction
from tis.common.scenario.base import Milliseconds, NonNegative, Part, Positive, Probability, refuse
from tis.common.scenario.network.delay import QuantileDelay, UniformDelay
from tis.common.scenario.network.pipeline import Ordering, Stages, against_recovery
from tis.common.units import NS_PER_MS, s_to_ns

BothOr = Literal[Direction, "both"]
_YEAR_S: Final = 31_536_000
_CELL_S: Final = 0.001

Moment = Annotated[float, Field(ge=0, le=_YEAR_S)]
Seconds = Annotated[float, Field(ge=_CELL_S, le=86_400)]
"""A duration on the grid of 1 ms, at least one cell."""

StateName = Annotated[str, Field(min_length=1, max_length=40)]

_FAILING: Final = "Direction that fails: forward, feedback or both."
EFFECT_TEXT: Final = (
    "What becomes of messages offered meanwhile. loss: they are lost; stall: they wait, and leave at its end."
)

Effect = Literal["loss", "stall"]


class Change(Stages):
    """A temporary change of every pipeline of a direction: the stages given here replace the pipeline's.

    A stage that is not given stays. A stage that lacks what it depends on has no effect: jitter, correlation and
    reorder without a delay, correlation with a trace as the delay, reorder with another ordering.
    """

    outage: bool = Field(False, description="true: every message that is offered is lost.")
    stall: bool = Field(
        False,
        description="true: nothing is sent; messages wait, and leave at the end of the stall, at the rate if any.",
    )
    clean: bool = Field(
        False, description="true: all stages of the pipeline that are not given here are removed meanwhile."
    )
    ordering: Ordering | None = Field(None, description="Ordering that replaces the pipeline's.")
    scale_rate: Annotated[float, Field(ge=0.001, le=1000)] = Field(
        1.0, description="Factor on the bit rate, or on the bytes of each recorded opportunity."
    )
    scale_delay: Annotated[float, Field(ge=0, le=1000)] = Field(1.0, description="Factor on each drawn delay.")
    add_delay_ms: Milliseconds = Field(0.0, description="Delay added to each message, after the factor, in ms.")
    add_p_loss: Probability = Field(
        0.0,
        description="Probability of an additional loss, 0 to 1, independent of the pipeline's losses, and of whole "
        "messages also where those are of packets (mtu_bytes).",
    )

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> Self:
        faults = []
        if self.correlation is not None and self.delay is not None and self.delay.kind == "trace":
            faults.append("correlation and a trace exclude each other: a trace has its own")
        if self.reorder is not None and self.ordering != "reorder":
            faults.append("reorder needs ordering: reorder")
        if self.recovery is not None:
            faults += against_recovery(self, self.ordering)
        refuse(faults)
        return self


class TimelineEntry(Part):
    """A change at a given run time, on a grid of 1 ms; messages in flight are unaffected.

    A rate, however, holds from its instant on for all that waits, and for the rest of what is being sent.
    Where several entries hold at once, the last one in the list wins, by stage; factors multiply, additions add.
    """

    at_s: Moment = Field(description="Run time at which the change begins, in s.")
    for_s: Annotated[float, Field(gt=0, le=_YEAR_S)] | None = Field(
        None, description="Duration of the change, in s, at least 1 ms; not given: to the end of the run."
    )
    ramp_s: Moment = Field(
        0.0,
        description="Time over which scale_rate, scale_delay, add_delay_ms and add_p_loss change at the beginning "
        "and return at the end, linearly, in s; everything else changes in a step.",
    )
    direction: BothOr = Field("both", description="Direction that changes: forward, feedback or both.")
    set: Change = Field(description="The change.")

    @model_validator(mode="after")
    def _ramps_fit(self) -> Self:
        if self.for_s is not None and 2 * self.ramp_s > self.for_s:
            raise ValueError(f"ramp_s must be at most half of for_s = {self.for_s}")
        return self


class PeriodicOutages(Part):
    """Outages of equal length at equal intervals."""

    kind: Literal["periodic"] = Field(description="periodic: outages at equal intervals.")
    every_s: Seconds = Field(description="Time from the beginning of one outage to that of the next, in s.")
    for_s: Seconds = Field(description="Duration of each outage, in s.")
    first_s: Moment | None = Field(
        None, description="Run time at which the first outage begins, in s; not given: every_s."
    )
    direction: BothOr = Field("both", description=_FAILING)
    effect: Effect = Field("loss", description=EFFECT_TEXT)

    @model_validator(mode="after")
    def _leaves_room(self) -> Self:
        if self.for_s >= self.every_s:
            raise ValueError(f"for_s must be less than every_s = {self.every_s}")
        return self


class PoissonOutages(Part):
    """Memoryless outages, with exponential gaps from the end of one to the beginning of the next."""

    kind: Literal["poisson"] = Field(description="poisson: outages with exponential gaps.")
    mean_gap_s: Seconds = Field(description="Mean gap from the end of an outage to the beginning of the next, in s.")
    mean_s: Seconds = Field(description="Mean duration of an outage, in s.")
    lengths: Literal["exponential", "constant"] = Field(
        "exponential", description="Distribution of the durations: exponential, or all equal to mean_s."
    )
    direction: BothOr = Field("both", description=_FAILING)
    effect: Effect = Field("loss", description=EFFECT_TEXT)


class Span(Part):
    """A duration that is uniformly distributed between two bounds."""

    low_s: NonNegative = Field(le=86_400, description="Lower bound, in s.")
    high_s: Seconds = Field(description="Upper bound, in s.")

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.high_s < self.low_s:
            raise ValueError(f"high_s must be at least low_s = {self.low_s}")
        return self


class AlternatingOutages(Part):
    """Down and up times alternate, each of a random duration; a run begins up."""

    kind: Literal["alternating"] = Field(description="alternating: uniformly distributed down and up times.")
    down: Span = Field(description="Duration of an outage.")
    up: Span = Field(description="Time between two outages.")
    direction: BothOr = Field("both", description=_FAILING)
    effect: Effect = Field("loss", description=EFFECT_TEXT)


Outages = Annotated[PeriodicOutages | PoissonOutages | AlternatingOutages, Field(discriminator="kind")]


class Steps(Part):
    """A delay on top of the pipeline's that takes another value at equal intervals, as on a satellite's next path."""

    every_s: Seconds = Field(description="Time from one value to the next, in s.")
    first_s: Moment | None = Field(
        None, description="Run time at which the first value is replaced, in s; not given: every_s."
    )
    delay: UniformDelay | QuantileDelay = Field(
        discriminator="kind", description="Distribution of the values: uniform or quantiles; each is drawn once."
    )
    direction: BothOr = Field("both", description="Direction that has it; both take the same values.")


class State(Part):
    """A named condition of the network."""

    name: StateName = Field(description="Name of the state, used in reports.")
    forward: Change = Field(Change(), description="Change from surgeon to patient while the state lasts.")
    feedback: Change = Field(Change(), description="Change from patient to surgeon while the state lasts.")


class Successor(Part):
    """A possible successor of a state."""

    to: StateName = Field(description="Name of the following state.")
    weight: Positive = Field(1.0, le=1e9, description="Relative probability among the successors.")


class MarkovState(State):
    """A state of random duration."""

    mean_s: Seconds = Field(description="Mean duration of a stay, in s (geometric on the grid of 1 ms).")
    next: tuple[Successor, ...] = Field(min_length=1, description="Possible following states.")


class TimedState(State):
    """A state of fixed duration."""

    for_s: Seconds = Field(description="Duration of the state, in s.")


def _state_faults(states: Sequence[State], named: set[str], field: str) -> list[str]:
    """Return the faults of states with equal names, and of names in ``field`` that no state has."""
    names = [state.name for state in states]
    faults = ["names of states must differ"] if len(set(names)) < len(names) else []
    unknown = sorted(named - set(names))
    return faults + [f"{field} must name states ({', '.join(names)}), not {name}" for name in unknown]


class MarkovStates(Part):
    """States that follow each other at random, for both directions together."""

    kind: Literal["markov"] = Field(description="markov: random durations and successors.")
    states: tuple[MarkovState, ...] = Field(
        min_length=1, max_length=32, description="The states; a run begins in the first."
    )

    @model_validator(mode="after")
    def _known(self) -> Self:
        refuse(_state_faults(self.states, {after.to for state in self.states for after in state.next}, "next"))
        return self


class CycleStates(Part):
    """States that repeat in a fixed cycle, such as the 15 s cycle of LEO satellites."""

    kind: Literal["cycle"] = Field(description="cycle: fixed durations, in the given order, repeated.")
    states: tuple[TimedState, ...] = Field(min_length=1, max_length=32, description="The states, in their order.")
    offset_s: Moment = Field(0.0, description="Position in the cycle at which the run begins, in s.")


class ScriptStep(Part):
    """The beginning of a state."""

    at_s: Moment = Field(description="Run time at which the state begins, in s.")
    state: StateName = Field(description="Name of the state.")


class ScriptedStates(Part):
    """States at given moments; before the first step the pipelines act unchanged."""

    kind: Literal["script"] = Field(description="script: states at given moments.")
    states: tuple[State, ...] = Field(min_length=1, max_length=32, description="The states.")
    steps: tuple[ScriptStep, ...] = Field(
        min_length=1, max_length=10_000, description="Beginnings of states, ascending, at least 1 ms apart."
    )

    @model_validator(mode="after")
    def _known(self) -> Self:
        faults = _state_faults(self.states, {step.state for step in self.steps}, "steps")
        at_ns = [s_to_ns(step.at_s) for step in self.steps]
        if any(after - before < NS_PER_MS for before, after in pairwise(at_ns)):
            faults.append("steps must ascend in at_s, by at least 0.001")
        refuse(faults)
        return self


States = Annotated[MarkovStates | CycleStates | ScriptedStates, Field(discriminator="kind")]
