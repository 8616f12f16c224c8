"""What is asked of a running emulator and what it answers, as JSON below ``<prefix>/netem/control/``.

Changes are those of a scenario: `Change`, held for a while or for good, from the next ms of run time on or from a
moment that is given.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Final, Literal, Self

from pydantic import BaseModel, Field, ValidationError, field_serializer, model_validator
from pydantic.json_schema import models_json_schema

from common.channels import Direction
from common.errors import Fault, InputError
from common.scenario.base import Part
from common.scenario.faults import faults
from common.scenario.network import NetworkPart
from common.scenario.network.conditions import BothOr, Change, Moment, TimelineEntry
from common.scenario.network.pipeline import Pipeline, Stages
from common.scenario.profile import ProfileName

STATE: Final = "state"
SCHEMA: Final = "schema"
ACKNOWLEDGED: Final = "acknowledged"
Operation = Literal["set", "outage", "reset", "profile"]
CLEARING: Final = ("reset", "profile")
"""Operations that end everything that was asked for before."""

_MS_PER_S: Final = 1000.0
_DAY_MS: Final = 86_400_000
_LIVING: Final = ("outages", "states", "timeline", "rules")

Id = Annotated[str, Field(max_length=100)]
_ID_TEXT: Final = "Comes back with the acknowledgement."


def control_prefix(prefix: str) -> str:
    """Return what every control key of an emulator begins with; ``prefix`` is the scenario's session."""
    return f"{prefix}/netem/control/"


EVERY_STATE: Final = f"{control_prefix('*')}{STATE}"
"""What every emulator answers with its state, whatever its prefix."""


class SetRequest(Part):
    """A change of one direction or both: what it gives replaces what earlier requests without an end gave."""

    id: Id | None = Field(None, description=_ID_TEXT)
    direction: BothOr = Field(description="forward, feedback or both.")
    change: Change = Field(description="What holds meanwhile, as in a scenario's timeline.")
    at_s: Moment | None = Field(None, description="When it begins, in s of run time; not given: at once.")
    for_s: Annotated[float, Field(gt=0, le=31_536_000)] | None = Field(
        None, description="How long it holds, in s; not given: until something else is set, or reset."
    )
    ramp_s: Moment = Field(0.0, description="How long factors and additions take to grow, and to shrink, in s.")

    @model_validator(mode="after")
    def _makes_sense(self) -> Self:
        if not self.change.model_fields_set:
            raise ValueError("change must say what is to change")
        if self.for_s is not None and 2 * self.ramp_s > self.for_s:
            raise ValueError(f"ramp_s must be at most half of for_s = {self.for_s}")
        return self

    def entry(self, now_s: float) -> TimelineEntry:
        """Return the entry of a timeline that this asks for."""
        at_s = now_s if self.at_s is None else self.at_s
        return TimelineEntry(
            at_s=at_s, for_s=self.for_s, ramp_s=self.ramp_s, direction=self.direction, set=self.change
        )


class OutageRequest(Part):
    """Silence for a while: what is offered meanwhile is lost."""

    id: Id | None = Field(None, description=_ID_TEXT)
    direction: BothOr = Field("both", description="forward, feedback or both.")
    for_ms: Annotated[float, Field(ge=1, le=_DAY_MS)] = Field(description="How long, in ms; a day at most.")

    def as_set(self) -> SetRequest:
        """Return the same as a change."""
        change = Change(outage=True)
        return SetRequest(id=self.id, direction=self.direction, change=change, for_s=self.for_ms / _MS_PER_S)


class ResetRequest(Part):
    """Nothing that was asked for while running holds any longer."""

    id: Id | None = Field(None, description=_ID_TEXT)


class ProfileRequest(Part):
    """Both directions become those of a profile; nothing that was asked for before holds any longer."""

    id: Id | None = Field(None, description=_ID_TEXT)
    profile: ProfileName = Field(description="Its name, as `tis net profiles` lists it.")
    network: dict[str, Any] | None = Field(
        None, description="Its network, as in a scenario; not given: that of the emulator's own library."
    )


class Held(Part):
    """From when a change of one direction holds, in ns of run time, and until when, if it ends."""

    direction: Direction
    from_ns: int
    until_ns: int | None = None


class Acknowledgement(Part):
    """The answer to a request: all of it is done, or nothing."""

    id: str | None = None
    operation: str
    accepted: bool
    at_ns: int | None = Field(None, description="Run time at which it was decided; none while there is no run.")
    from_ns: int | None = Field(None, description="Run time from which the first of it holds.")
    held: tuple[Held, ...] = Field((), description="Each change of each direction.")
    reasons: tuple[str, ...] = Field((), description="Why it was refused, all at once.")


class RuleState(Part):
    """A rule: its keys, its pipeline as the scenario has it, and as it is now."""

    key: str
    pipeline: Pipeline
    now: Pipeline


class DirectionState(Part):
    """What holds in one direction now; a delay becomes ``delay * scale_delay + add_delay_ms``."""

    state: str | None = Field(None, description="Name of the joint state, if there are any.")
    outage: bool
    scale_delay: float
    add_delay_ms: float
    add_p_loss: float
    until_s: float | None = Field(None, description="Run time until which this surely holds; none: for good.")
    pipeline: Pipeline = Field(description="The direction's own pipeline as the scenario has it.")
    now: Pipeline = Field(description="The same as it is now, stages replaced.")
    rules: tuple[RuleState, ...]
    added: tuple[TimelineEntry, ...] = Field(description="Changes asked for while running that hold, or will.")
    counters: dict[str, int]

    @field_serializer("added")
    def _as_asked(self, added: tuple[TimelineEntry, ...]) -> list[dict[str, Any]]:
        """Leave out what was not asked for."""
        return [entry.model_dump(mode="json", exclude_unset=True) for entry in added]


class EmulatorState(Part):
    """What a running emulator does now."""

    running: bool
    at_s: float | None = Field(None, description="Run time; none while nothing passes yet, or no longer.")
    unmatched: Literal["refuse", "pass"] = "refuse"
    forward: DirectionState | None = None
    feedback: DirectionState | None = None
    counters: dict[str, int] = {}  # noqa: RUF012 - pydantic copies defaults


def request_schema() -> dict[str, Any]:
    """Return the JSON Schema of a mapping from operations to the requests that they take."""
    models: dict[str, type[BaseModel]]
    models = {"set": SetRequest, "outage": OutageRequest, "reset": ResetRequest, "profile": ProfileRequest}
    places, definitions = models_json_schema([(model, "validation") for model in models.values()])
    requests: dict[str, Any] = {name: places[model, "validation"] for name, model in models.items()}
    requests["set"] = {"anyOf": [requests["set"], {"type": "array", "items": requests["set"]}]}
    title = "Requests to a running emulator, by their operation"
    return {"title": title, "type": "object", "properties": requests, **definitions}


def profile_requests(name: str, network: Mapping[str, Any], request_id: str | None = None) -> tuple[SetRequest, ...]:
    """Return the changes that turn both directions into those of a profile's network; raises `InputError`.

    Stages that the profile has not are absent. What lives in time or belongs to single keys cannot be taken on while
    running.
    """
    try:
        part = NetworkPart.model_validate({k: v for k, v in network.items() if k != "from_profile"})
    except ValidationError as error:
        found = faults(error, NetworkPart, "profile")
    else:
        living = [field for field in _LIVING if getattr(part, field)]
        if not living:
            both = (("forward", part.forward), ("feedback", part.feedback))
            return tuple(
                SetRequest(id=request_id, direction=direction, change=_whole(pipeline))
                for direction, pipeline in both
            )
        rule = f"must be a network that stays as it is; this one has {' and '.join(living)}: start with it instead"
        found = [Fault("profile", "", rule, name)]
    raise InputError(found)


def _whole(pipeline: Pipeline) -> Change:
    stages = {name: stage for name in Stages.model_fields if (stage := getattr(pipeline, name)) is not None}
    return Change(clean=True, ordering=pipeline.ordering, **stages)
