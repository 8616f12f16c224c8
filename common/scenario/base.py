"""Base class of every part of a scenario: frozen, unknown keys refused, a description on every field."""

from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema


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


Probability = Annotated[float, Field(ge=0, le=1)]
NonNegative = Annotated[float, Field(ge=0)]
Milliseconds = Annotated[float, Field(ge=0, le=3_600_000)]  # an hour: far below the overflow of int64 ns
Positive = Annotated[float, Field(gt=0)]
