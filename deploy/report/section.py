"""The parts of a summary: models whose descriptions say what each figure of ``summary.json`` means."""

from typing import Annotated, Any, Final

from pydantic import BaseModel, ConfigDict, Field

from tis.common.channels import Direction, Hand, Side
from tis.common.metrics.percentiles import is_resolvable
from tis.deploy.present.numbers import number, rounded_up

Statistics = dict[str, float | None]
"""Statistics by name, such as ``p50``; None for unknown."""

HandName = Annotated[Hand, Field(description="HAND")]
SideName = Annotated[Side, Field(description="SIDE")]
DirectionName = Annotated[Direction, Field(description="DIRECTION")]
EstimatorName = Annotated[str, Field(description="ESTIMATOR")]
MethodName = Annotated[str, Field(description="METHOD")]
KeyName = Annotated[str, Field(description="KEY")]
KindName = Annotated[str, Field(description="KIND")]
ReasonName = Annotated[str, Field(description="REASON")]
NOT_RESOLVABLE: Final = "not resolvable"
"""Text of a figure that the clock uncertainty exceeds."""

LATE: Final = "p50 p95 p99 max"
DELAYS: Final = "mean std p50 p90 p95 p99 p99.9 max"
VARIATIONS: Final = "mean p50 p90 p95 p99 p99.9 max"
MEAN_LATE: Final = f"mean {LATE}"


def means(about: str, **options: Any) -> Any:
    """Return a field with its meaning; ``default`` is the value of a key that may be absent."""
    return Field(description=about, **options)


def statistics(about: str, names: str = LATE, **options: Any) -> Any:
    """Return a field of statistics with these names, which its JSON schema requires; ``options`` as for `means`."""
    return Field(description=about, json_schema_extra={"required": names.split()}, **options)  # type: ignore[dict-item]


class Section(BaseModel):
    """A part of a summary; a key that depends on the run, and is absent in this one, is a field that was not set."""

    model_config = ConfigDict(frozen=True, protected_namespaces=())

    def __getitem__(self, place: str) -> Any:
        """Return what stands at a dotted place: ``latency_ms.end_to_end``."""
        part: Any = self
        for name in place.split("."):
            part = getattr(part, name) if isinstance(part, Section) else part[name]
        return part

    def as_json(self) -> dict[str, Any]:
        """Return the part as it stands in ``summary.json``."""
        return self.model_dump(exclude_unset=True)


def with_uncertainty(value: float | None, bound: float | None, unit: str = "") -> str:
    """Return a figure as text: ``12.41 ms``, ``12.41 \u00b1 0.08 ms``, or ``not resolvable``.

    ``bound`` is the clock uncertainty, which is rounded up; a figure of a single clock has none.
    """
    if value is None or not bound:
        return number(value, unit)
    if not is_resolvable(value, bound):
        return NOT_RESOLVABLE
    text = number(value)
    return f"{text} \u00b1 {rounded_up(bound, len(text.partition('.')[2]))}{unit}"
