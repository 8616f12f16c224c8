"""Base class of every part of a scenario, and the types of fields that several parts share.

Parts are frozen, refuse unknown keys and describe every field.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

from tis.common.channels import Hand


class Part(BaseModel):
    """A part of a scenario."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


@dataclass(frozen=True)
class RuleText:
    """Error message of a field: one sentence, whichever pattern or union branch refused the value."""

    rule: str

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.custom_error_schema(
            handler(source), custom_error_type="in_words", custom_error_message=self.rule
        )


def obeys(fault_of: Callable[[str], str | None]) -> AfterValidator:
    """Return the check of a text by ``fault_of``, which returns the rule that it breaks, None for a sound one."""

    def checked(value: str) -> str:
        refuse(filter(None, [fault_of(value)]))
        return value

    return AfterValidator(checked)


def distinct(what: str) -> AfterValidator:
    """Return the check that a list names each ``what`` at most once."""

    def checked(values: tuple[Any, ...]) -> tuple[Any, ...]:
        if len(set(values)) != len(values):
            raise ValueError(f"must name each {what} at most once")
        return values

    return AfterValidator(checked)


def refuse(broken: Iterable[str]) -> None:
    """Raise `ValueError` with the rules that are broken, a line each; do nothing without any."""
    rules = list(broken)
    if rules:
        raise ValueError("\n".join(rules))


Probability = Annotated[float, Field(ge=0, le=1)]
NonNegative = Annotated[float, Field(ge=0)]
Milliseconds = Annotated[float, Field(ge=0, le=3_600_000)]  # an hour: far below the overflow of int64 ns
Positive = Annotated[float, Field(gt=0)]

TraceFile = Annotated[str, Field(min_length=1, description="CSV file in the format of `tis net probe`.")]
Advance = Annotated[
    Literal["packet", "time"],
    Field(description="packet: each message uses the next row; time: the row at its run time."),
]


Start = Annotated[
    Annotated[int, Field(ge=0, strict=True)] | Literal["auto"],
    RuleText("must be a row number (an integer >= 0) or 'auto'"),
]

START_MEANING: Final = (
    "Row that becomes sample 0, from 0; auto: the first row after the training rows of own_head, else row 0."
)
HANDS_MEANING: Final = "Masters that move: left, right or both."


Hands = Annotated[tuple[Hand, ...], Field(min_length=1, max_length=2), distinct("hand")]


class AnySource(Part):
    """What every source of the surgeon's movement tells of itself; each kind adds its fields."""

    @property
    def label(self) -> str:
        """Return the origin of the movement in words."""
        raise NotImplementedError

    @property
    def synthetic(self) -> bool:
        """Tell whether a program of the testbed made the movement; a table says nothing of its origin."""
        return False

    @property
    def device_keys(self) -> tuple[str, ...]:
        """Return the key expressions of the devices that a movement comes from while the run goes on."""
        return ()

    def rules(self, session: str, rate_hz: int, train: str, plant: str) -> dict[str, bool]:  # noqa: ARG002
        """Return the rules between this source and other parts of the scenario, each with whether it holds.

        ``train`` is how models are trained, ``plant`` the kind of the patient's arm.
        """
        rule = "identification.train can be synthetic with a live source only: own_head trains on a source's own rows"
        return {rule: train != "synthetic"}
