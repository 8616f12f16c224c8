"""What changes while a run lasts: outages, states that drive several stages together, and a timeline.

Everything here happens in run time, on a grid of 1 ms, to all keys of a direction at once. It applies to messages
that are offered meanwhile; those in flight are not touched.
"""

from itertools import pairwise
from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

from common.channels import Direction
from common.scenario.base import Milliseconds, NonNegative, Part, Positive, Probability
from common.scenario.network.pipeline import Ordering, Stages
from common.units import NS_PER_MS, s_to_ns

BothOr = Literal[Direction, "both"]
_YEAR_S: Final = 31_536_000
_CELL_S: Final = 0.001

Moment = Annotated[float, Field(ge=0, le=_YEAR_S)]
Seconds = Annotated[float, Field(ge=_CELL_S, le=86_400)]
"""A length of time on the grid of 1 ms; what is shorter could not be told from it."""

StateName = Annotated[str, Field(min_length=1, max_length=40)]


class Change(Stages):
    """What holds meanwhile, on top of every pipeline of the direction: stages given here replace the pipeline's.

    A stage that is not given stays. What is left without what it needs does nothing meanwhile: jitter, correlation
    and reorder where a pipeline has no delay, correlation where the delay is a trace, reorder where the ordering is
    another.
    """

    outage: bool = Field(False, description="true: every message that is offered is lost.")
    clean: bool = Field(
        False, description="true: nothing of the pipeline stays; a stage that is not given here is absent meanwhile."
    )
    ordering: Ordering | None = Field(None, description="Replaces the pipeline's ordering.")
    scale_delay: Annotated[float, Field(ge=0, le=1000)] = Field(1.0, description="Factor on each delay drawn.")
    add_delay_ms: Milliseconds = Field(0.0, description="Added to each delay, after the factor, in ms.")
    add_p_loss: Probability = Field(0.0, description="Further loss, independent of the pipeline's.")

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> Self:
        faults = []
        if self.correlation is not None and self.delay is not None and self.delay.kind == "trace":
            faults.append("correlation and a trace exclude each other: a trace has its own")
        if self.reorder is not None and self.ordering != "reorder":
            faults.append("reorder needs ordering: reorder")
        if faults:
            raise ValueError("\n".join(faults))
        return self


class TimelineEntry(Part):
    """A change at a moment of run time, on a grid of 1 ms; messages in flight are not touched.

    Where several hold at once, the later in the list wins stage by stage; factors multiply, additions add.
    """

    at_s: Moment = Field(description="When it begins, in s of run time.")
    for_s: Annotated[float, Field(gt=0, le=_YEAR_S)] | None = Field(
        None, description="How long it holds, in s, at least 1 ms; not given: to the end."
    )
    ramp_s: Moment = Field(
        0.0,
        description="scale_delay, add_delay_ms and add_p_loss grow for so many s after the beginning, and shrink "
        "for as many before the end; everything else steps at once.",
    )
    direction: BothOr = Field("both", description="Which direction it applies to.")
    set: Change = Field(description="What holds meanwhile.")

    @model_validator(mode="after")
    def _ramps_fit(self) -> Self:
        if self.for_s is not None and 2 * self.ramp_s > self.for_s:
            raise ValueError(f"ramp_s must be at most half of for_s = {self.for_s}")
        return self


class PeriodicOutages(Part):
    """An outage of equal length, again and again."""

    kind: Literal["periodic"] = Field(description="periodic: at equal intervals.")
    every_s: Seconds = Field(description="From the beginning of one to that of the next, in s.")
    for_s: Seconds = Field(description="How long each lasts, in s.")
    first_s: Moment | None = Field(None, description="When the first begins, in s; every_s when not given.")
    direction: BothOr = Field("both", description="Which direction falls silent.")

    @model_validator(mode="after")
    def _leaves_room(self) -> Self:
        if self.for_s >= self.every_s:
            raise ValueError(f"for_s must be less than every_s = {self.every_s}")
        return self


class PoissonOutages(Part):
    """Outages that come without memory: exponential gaps from the end of one to the beginning of the next."""

    kind: Literal["poisson"] = Field(description="poisson: exponential gaps between outages.")
    mean_gap_s: Seconds = Field(description="Mean gap from the end of one to the next, in s.")
    mean_s: Seconds = Field(description="Mean length of an outage, in s.")
    lengths: Literal["exponential", "constant"] = Field("exponential", description="How the lengths spread.")
    direction: BothOr = Field("both", description="Which direction falls silent.")


class Span(Part):
    """A length of time between two bounds, equally likely."""

    low_s: NonNegative = Field(le=86_400, description="Shortest, in s.")
    high_s: Seconds = Field(description="Longest, in s.")

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.high_s < self.low_s:
            raise ValueError(f"high_s must be at least low_s = {self.low_s}")
        return self


class AlternatingOutages(Part):
    """Down and up take turns, each for a random length; a run begins up."""

    kind: Literal["alternating"] = Field(description="alternating: random lengths down and up.")
    down: Span = Field(description="How long an outage lasts.")
    up: Span = Field(description="How long it is until the next.")
    direction: BothOr = Field("both", description="Which direction falls silent.")


Outages = Annotated[PeriodicOutages | PoissonOutages | AlternatingOutages, Field(discriminator="kind")]


class State(Part):
    """A condition of the network that has a name."""

    name: StateName = Field(description="Name, as in reports.")
    forward: Change = Field(Change(), description="What holds from surgeon to patient meanwhile.")
    feedback: Change = Field(Change(), description="What holds from patient to surgeon meanwhile.")


class Successor(Part):
    """Where a state may lead."""

    to: StateName = Field(description="Name of the state.")
    weight: Positive = Field(1.0, le=1e9, description="Its weight among the successors.")


class MarkovState(State):
    """A state that is left at random."""

    mean_s: Seconds = Field(description="Mean length of a stay, in s (geometric on the grid of 1 ms).")
    next: tuple[Successor, ...] = Field(min_length=1, description="Which states follow.")


class TimedState(State):
    """A state of a cycle."""

    for_s: Seconds = Field(description="How long it lasts, in s.")


class MarkovStates(Part):
    """States that follow each other at random, both directions together."""

    kind: Literal["markov"] = Field(description="markov: random stays, random successors.")
    states: tuple[MarkovState, ...] = Field(min_length=1, max_length=32, description="The first is the initial one.")

    @model_validator(mode="after")
    def _known(self) -> Self:
        names = [state.name for state in self.states]
        faults = ["names of states must differ"] if len(set(names)) < len(names) else []
        unknown = sorted({after.to for state in self.states for after in state.next} - set(names))
        faults += [f"next must name states ({', '.join(names)}), not {name}" for name in unknown]
        if faults:
            raise ValueError("\n".join(faults))
        return self


class CycleStates(Part):
    """States that follow each other like clockwork, as the 15 s cycle of LEO satellites."""

    kind: Literal["cycle"] = Field(description="cycle: fixed stays, in the order given, over and over.")
    states: tuple[TimedState, ...] = Field(min_length=1, max_length=32, description="In their order.")
    offset_s: Moment = Field(0.0, description="How far into the cycle the run begins, in s.")


class ScriptStep(Part):
    """A moment at which a state begins."""

    at_s: Moment = Field(description="When, in s of run time.")
    state: StateName = Field(description="Which state.")


class ScriptedStates(Part):
    """States at moments that are given; before the first step the pipelines hold as they are."""

    kind: Literal["script"] = Field(description="script: at the moments given.")
    states: tuple[State, ...] = Field(min_length=1, max_length=32, description="The states.")
    steps: tuple[ScriptStep, ...] = Field(
        min_length=1, max_length=10_000, description="When which begins, ascending, 1 ms apart or more."
    )

    @model_validator(mode="after")
    def _known(self) -> Self:
        names = [state.name for state in self.states]
        faults = ["names of states must differ"] if len(set(names)) < len(names) else []
        unknown = sorted({step.state for step in self.steps} - set(names))
        faults += [f"steps must name states ({', '.join(names)}), not {name}" for name in unknown]
        at_ns = [s_to_ns(step.at_s) for step in self.steps]
        if any(after - before < NS_PER_MS for before, after in pairwise(at_ns)):
            faults.append("steps must ascend in at_s, by at least 0.001")
        if faults:
            raise ValueError("\n".join(faults))
        return self


States = Annotated[MarkovStates | CycleStates | ScriptedStates, Field(discriminator="kind")]
