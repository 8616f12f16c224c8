"""The emulated network of a scenario. Every number is one way, per direction."""

from typing import Annotated, Literal, Self, get_args

from pydantic import Field, StringConstraints, field_validator, model_validator

from tis.common.channels import Direction
from tis.common.scenario.base import Part, obeys, refuse
from tis.common.scenario.network.conditions import BothOr, Change, Outages, States, Steps, TimelineEntry
from tis.common.scenario.network.pipeline import Pipeline, against_recovery
from tis.common.zenoh_syntax import key_expression_fault

KeyExpression = Annotated[str, StringConstraints(min_length=1), obeys(key_expression_fault)]


class Rule(Part):
    """A separate pipeline for the keys that match; the most specific rule wins."""

    key: KeyExpression = Field(description="Zenoh key expression of the keys, like */MTML/measured_cp.")
    direction: BothOr = Field(
        description="forward: surgeon to patient (west to east); feedback: patient to surgeon; or both."
    )
    pipeline: Pipeline = Field(
        description="Pipeline of these messages; {}: no stages, so only what changes with time acts."
    )


class Buffer(Part):
    """Bound on the messages that netem holds in each direction, and so on its memory."""

    max_packets: Annotated[int, Field(strict=True, ge=1, le=10_000_000)] = Field(
        200_000, description="Maximum number of messages that wait for their release."
    )
    max_mb: Annotated[float, Field(gt=0, le=1_000_000)] = Field(
        512.0,
        description="Maximum memory that they take, in MB (10**6 bytes): payload, attachment and 1 kB for each "
        "message, 10 kB for a query, a reply or a message above 16 kB.",
    )
    policy: Literal["drop_newest", "drop_oldest"] = Field(
        "drop_newest",
        description="Message that is dropped when the buffer is full: the one offered, or the one held longest.",
    )


class NetworkPart(Part):
    """The emulated network between surgeon and patient."""

    profile: str | None = Field(
        None,
        description="Name of a network in the profile library (`tis net profiles`); fields given beside it override "
        "the profile's. A loaded scenario holds the profile's values, and its name in from_profile.",
    )
    from_profile: str | None = Field(
        None, description="Name of the profile that supplied the values; a label that the software writes."
    )
    unmatched: Literal["refuse", "pass"] = Field(
        "refuse",
        description="Treatment of keys outside the session that no rule names: refused and counted, or passed "
        "unimpaired.",
    )
    forward: Pipeline = Field(Pipeline(), description="Pipeline from surgeon to patient, west to east.")
    feedback: Pipeline = Field(Pipeline(), description="Pipeline from patient to surgeon, east to west.")
    rules: tuple[Rule, ...] = Field((), description="Pipelines of particular keys.")
    outages: tuple[Outages, ...] = Field((), description="Recurring outages.")
    steps: tuple[Steps, ...] = Field(
        (), max_length=4, description="Delays that take another value at equal intervals; several add up."
    )
    states: States | None = Field(None, description="Joint states that change delay, loss and rate together.")
    timeline: tuple[TimelineEntry, ...] = Field((), description="Changes at given moments of the run.")
    buffer: Buffer = Field(Buffer(), description="Bound on the messages that netem holds in each direction.")

    def corrupts(self, direction: Direction) -> bool:
        """Tell whether bits of messages flip in a direction, at any time of the run."""
        return any(stages.corrupt is not None for stages in (*self._pipelines(direction), *self._changes(direction)))

    def _pipelines(self, direction: Direction) -> list[Pipeline]:
        rules = [rule.pipeline for rule in self.rules if rule.direction in (direction, "both")]
        return [getattr(self, direction), *rules]

    def _changes(self, direction: Direction) -> list[Change]:
        changes = [getattr(state, direction) for state in self.states.states] if self.states else []
        return changes + [entry.set for entry in self.timeline if entry.direction in (direction, "both")]

    @model_validator(mode="after")
    def _recovers_alone(self) -> Self:
        """Refuse changes that bring to a recovery, at any time, what it excludes."""
        faults: list[str] = []
        for direction in get_args(Direction):
            pipelines, changes = self._pipelines(direction), self._changes(direction)
            beside: list[Pipeline | Change] = []
            if any(stages.recovery for stages in (*pipelines, *changes)):
                beside += changes
            if any(change.recovery for change in changes):
                beside += pipelines
            rules = (rule for stages in beside for rule in against_recovery(stages, stages.ordering))
            faults += [f"{direction}: {rule}" for rule in rules]
        refuse(dict.fromkeys(faults))
        return self

    @property
    def pushes_back(self) -> bool:
        """Tell whether a full queue holds senders back, at any time of the run."""
        states = self.states.states if self.states else ()
        changes = [change for state in states for change in (state.forward, state.feedback)]
        changes += [entry.set for entry in self.timeline]
        stages = (self.forward, self.feedback, *(rule.pipeline for rule in self.rules), *changes)
        return any(getattr(one.rate, "backpressure", False) for one in stages)

    @field_validator("profile")
    @classmethod
    def _filled_in(cls, profile: str | None) -> None:
        """Refuse a profile that was not expanded, since the network would be another one."""
        if profile is not None:
            raise ValueError("must have been replaced by its values, as `tis validate SCENARIO > FILE` does")
