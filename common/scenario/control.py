"""Requests to a running emulator and its answers: JSON below ``<prefix>/netem/control/``.

A change has the form of a scenario's `Change`. It takes effect from the next ms of run time or from a given instant,
for a given time or until it is replaced.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Final, Literal, Self

from pydantic import BaseModel, Field, ValidationError, field_serializer, model_validator
from pydantic.json_schema import models_json_schema

from tis.common.channels import Direction
from tis.common.errors import Fault, InputError
from tis.common.scenario.base import Part
from tis.common.scenario.faults import faults
from tis.common.scenario.network import NetworkPart
from tis.common.scenario.network.conditions import EFFECT_TEXT, BothOr, Change, Effect, Moment, TimelineEntry
from tis.common.scenario.network.pipeline import Pipeline, Stages
from tis.common.scenario.profile import ProfileName
from tis.common.scenario.sight import SightPart

STATE: Final = "state"
SCHEMA: Final = "schema"
ACKNOWLEDGED: Final = "acknowledged"
Operation = Literal["set", "outage", "reset", "profile"]
CLEARING: Final = ("reset", "profile")
"""Operations that cancel all earlier requests."""

_MS_PER_S: Final = 1000.0
_DAY_MS: Final = 86_400_000
_DYNAMIC: Final = ("outages", "steps", "states", "timeline", "rules")

Id = Annotated[str, Field(max_length=100)]
_ID_TEXT: Final = "Identifier of the caller's choice, returned in the acknowledgement."


def control_prefix(prefix: str) -> str:
    """Return the prefix of an emulator's control keys; ``prefix`` is the scenario's session."""
    return f"{prefix}/netem/control/"


EVERY_STATE: Final = f"{control_prefix('*')}{STATE}"
"""Key expression that every emulator answers with its state, whatever its prefix."""


class SetRequest(Part):
    """A change of one direction or both; its fields replace those of earlier requests without an end."""

    id: Id | None = Field(None, description=_ID_TEXT)
    direction: BothOr = Field(description="Direction that changes: forward, feedback or both.")
    change: Change = Field(description="The change, as under set in a scenario's timeline.")
    at_s: Moment | None = Field(None, description="Run time at which it begins, in s; not given: immediately.")
    for_s: Annotated[float, Field(gt=0, le=31_536_000)] | None = Field(
        None, description="Duration of the change, in s; not given: until the next set without an end, or a reset."
    )
    ramp_s: Moment = Field(
        0.0,
        description="Time over which scale_rate, scale_delay, add_delay_ms and add_p_loss change at the beginning "
        "and return at the end, in s.",
    )

    @model_validator(mode="after")
    def _makes_sense(self) -> Self:
        if not self.change.model_fields_set:
            raise ValueError("change must set at least one field")
        if self.for_s is not None and 2 * self.ramp_s > self.for_s:
            raise ValueError(f"ramp_s must be at most half of for_s = {self.for_s}")
        return self

    def entry(self, now_s: float) -> TimelineEntry:
        """Return the request as an entry of the timeline."""
        at_s = now_s if self.at_s is None else self.at_s
        return TimelineEntry(
            at_s=at_s, for_s=self.for_s, ramp_s=self.ramp_s, direction=self.direction, set=self.change
        )


class OutageRequest(Part):
    """An outage that begins immediately: every message offered during it is lost, or waits for its end."""

    id: Id | None = Field(None, description=_ID_TEXT)
    direction: BothOr = Field("both", description="Direction that fails: forward, feedback or both.")
    for_ms: Annotated[float, Field(ge=1, le=_DAY_MS)] = Field(description="Duration, in ms; at most a day.")
    effect: Effect = Field("loss", description=EFFECT_TEXT)

    def as_set(self) -> SetRequest:
        """Return the outage as a change."""
        change = Change(outage=True) if self.effect == "loss" else Change(stall=True)
        return SetRequest(id=self.id, direction=self.direction, change=change, for_s=self.for_ms / _MS_PER_S)


class ResetRequest(Part):
    """Cancellation of all changes that were requested during the run."""

    id: Id | None = Field(None, description=_ID_TEXT)


class ProfileRequest(Part):
    """A profile for both directions; it cancels all earlier requests."""

    id: Id | None = Field(None, description=_ID_TEXT)
    profile: ProfileName = Field(description="Name of the profile, as `tis net profiles` lists it.")
    network: dict[str, Any] | None = Field(
        None,
        description="Network of the profile, as under network in a scenario; not given: the one that the "
        "emulator's own library holds under this name.",
    )


class Held(Part):
    """Period during which a change of one direction holds."""

    direction: Direction = Field(description="Direction that changes.")
    from_ns: int = Field(description="Run time at which the change takes effect, in ns.")
    until_ns: int | None = Field(None, description="Run time at which it ends, in ns; null: it has no end.")


class Acknowledgement(Part):
    """Answer to a request, which is carried out completely or not at all."""

    id: str | None = Field(None, description="Identifier that the request carried.")
    operation: str = Field(description="Requested operation: set, outage, reset or profile.")
    accepted: bool = Field(description="true: the request is carried out; false: it is refused.")
    at_ns: int | None = Field(None, description="Run time of the decision, in ns; null while no run is in progress.")
    from_ns: int | None = Field(None, description="Run time at which the first change takes effect, in ns.")
    held: tuple[Held, ...] = Field((), description="Period of each change, one entry per direction.")
    reasons: tuple[str, ...] = Field((), description="All reasons for a refusal.")


class RuleState(Part):
    """A rule for some keys, as configured and as it acts at present."""

    key: str = Field(description="Key expression of the rule.")
    pipeline: Pipeline = Field(description="Pipeline of the rule, as configured.")
    now: Pipeline = Field(description="The pipeline in effect at present, with replaced stages.")


class RecentDelays(Part):
    """Delays of the messages that left during the last seconds, as netem realised them."""

    within_s: float = Field(description="Length of that time, in s.")
    n: int = Field(description="Number of these messages.")
    p50_ms: float = Field(description="Their median delay, in ms.")
    p99_ms: float = Field(description="99th percentile of their delays, in ms.")


class DirectionState(Part):
    """Present condition of one direction; a drawn delay becomes ``delay * scale_delay + add_delay_ms``."""

    state: str | None = Field(None, description="Name of the present state; null where no states are configured.")
    outage: bool = Field(description="true: every message that is offered is lost.")
    stall: bool = Field(False, description="true: nothing is sent; messages wait for the end.")
    scale_rate: float = Field(1.0, description="Factor on the bit rate.")
    scale_delay: float = Field(description="Factor on each drawn delay.")
    add_delay_ms: float = Field(description="Delay added after the factor, in ms.")
    add_p_loss: float = Field(description="Additional probability of loss, 0 to 1.")
    until_s: float | None = Field(
        None, description="Earliest run time at which the condition can change, in s; null: it does not change."
    )
    pipeline: Pipeline = Field(description="Pipeline of the direction, as configured.")
    now: Pipeline = Field(description="The pipeline in effect at present, with replaced stages.")
    rules: tuple[RuleState, ...] = Field(description="Rules of the direction.")
    added: tuple[TimelineEntry, ...] = Field(
        description="Changes requested during the run that are in effect or still to come."
    )
    counters: dict[str, int] = Field(description="Number of packets of the direction by outcome.")
    delays: RecentDelays | None = Field(
        None, description="Delays of what left lately; null where nothing left, and in a run of the testbed."
    )

    @field_serializer("added")
    def _as_asked(self, added: tuple[TimelineEntry, ...]) -> list[dict[str, Any]]:
        """Omit the fields that the request did not set."""
        return [entry.model_dump(mode="json", exclude_unset=True) for entry in added]


class EmulatorState(Part):
    """Present state of a running emulator."""

    running: bool = Field(description="true while the emulator forwards messages.")
    standalone: bool = Field(
        False, description="true: netem runs by itself; false: it is part of a run, with surgeon and patient."
    )
    at_s: float | None = Field(None, description="Run time, in s; null before the run begins and after it ends.")
    unmatched: Literal["refuse", "pass"] = Field(
        "refuse", description="Treatment of keys that no rule names: refused, or passed unimpaired."
    )
    forward: DirectionState | None = Field(None, description="Surgeon to patient, west to east.")
    feedback: DirectionState | None = Field(None, description="Patient to surgeon, east to west.")
    counters: dict[str, int] = Field({}, description="Counters of the whole emulator, by name.")
    sight: SightPart | None = Field(
        None,
        description="The run's camera and screen, by which observers decode the picture; null: none.",
    )


def request_schema() -> dict[str, Any]:
    """Return the JSON Schema of the requests, by operation."""
    models: dict[str, type[BaseModel]]
    models = {"set": SetRequest, "outage": OutageRequest, "reset": ResetRequest, "profile": ProfileRequest}
    places, definitions = models_json_schema([(model, "validation") for model in models.values()])
    requests: dict[str, Any] = {name: places[model, "validation"] for name, model in models.items()}
    # Several changes may be set by one request, which is accepted or refused as a whole.
    requests["set"] = {"anyOf": [requests["set"], {"type": "array", "items": requests["set"]}]}
    title = "Requests to a running emulator, by their operation"
    return {"title": title, "type": "object", "properties": requests, **definitions}


def profile_requests(name: str, network: Mapping[str, Any], request_id: str | None = None) -> tuple[SetRequest, ...]:
    """Return the changes that apply a profile's network to both directions; raises `InputError`.

    Stages that the profile lacks are removed. Outages, states, timelines and rules cannot be applied during a run.
    """
    try:
        part = NetworkPart.model_validate({k: v for k, v in network.items() if k != "from_profile"})
    except ValidationError as error:
        found = faults(error, NetworkPart, "profile")
    else:
        dynamic = [field for field in _DYNAMIC if getattr(part, field)]
        if not dynamic:
            both = (("forward", part.forward), ("feedback", part.feedback))
            return tuple(
                SetRequest(id=request_id, direction=direction, change=_whole(pipeline))
                for direction, pipeline in both
            )
        rule = (
            f"must be a static network to apply it during a run; this one has {' and '.join(dynamic)}: start netem "
            "or the run with it, by --profile"
        )
        found = [Fault("profile", "", rule, name)]
    raise InputError(found)


def _whole(pipeline: Pipeline) -> Change:
    stages = {name: stage for name in Stages.model_fields if (stage := getattr(pipeline, name)) is not None}
    return Change(clean=True, ordering=pipeline.ordering, **stages)
