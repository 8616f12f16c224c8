"""What a run is held against beside the usual requirements: limits of one's own, or those of one application."""

from typing import Final, Self

from pydantic import Field

from common.channels import Direction
from common.scenario.base import NonNegative, Part, Positive
from common.scenario.requirements import P99, REQUIREMENTS, Application, Metric, Requirement

_METRIC_OF: Final[dict[str, Metric]] = {
    "end_to_end_p99_ms": "end_to_end",
    "one_way_p99_ms": "one_way",
    "round_trip_p99_ms": "round_trip",
    "pdv_p99_ms": "pdv",
    "age_p99_ms": "age",
    "loss_max_pct": "loss",
    "rmse_3d_max_mm": "rmse_3d",
}
_EACH_WAY: Final[tuple[Metric, ...]] = ("one_way", "pdv", "loss")
_NO_PERCENTILE: Final[tuple[Metric, ...]] = ("loss", "rmse_3d")


class Limits(Part):
    """What the run is held against; whether it is met shows in the summary's verdicts."""

    preset: Application | None = Field(
        None,
        description="Limits that an application is said to need; numbers given beside it take precedence. "
        + "; ".join(f"{name}: {needed.source}" for name, needed in REQUIREMENTS.items())
        + ".",
    )
    end_to_end_p99_ms: Positive | None = Field(
        None,
        description="Largest 99th percentile of the end-to-end latency; not given: the preset's, if there is one.",
    )
    one_way_p99_ms: Positive | None = Field(
        None, description="Largest 99th percentile of the network's one-way delay, each way."
    )
    round_trip_p99_ms: Positive | None = Field(
        None, description="Largest 99th percentile of the round trip on the surgeon's clock, ticks included."
    )
    pdv_p99_ms: Positive | None = Field(
        None, description="Largest 99th percentile of the delay above the smallest (PDV, RFC 5481), each way."
    )
    age_p99_ms: Positive | None = Field(
        None, description="Largest 99th percentile of the age of the freshest sample at the ticks."
    )
    loss_max_pct: NonNegative | None = Field(
        None,
        le=100,
        description="Largest share of packets lost, each way; copies of a sample count one by one. Not given: the "
        "preset's, if it has one. 0: none of this run's.",
    )
    rmse_3d_max_mm: Positive | None = Field(
        None, description="Largest root mean square error of the active estimator's position, in 3D."
    )

    def resolved(self) -> Self:
        """Return the limits with the preset's numbers where none are given."""
        if self.preset is None:
            return self
        needed = [one for one in REQUIREMENTS[self.preset].requirements if one.binding]
        limits = {
            field: min((one.limit for one in needed if one.metric == metric), default=None)
            for field, metric in _METRIC_OF.items()
            if getattr(self, field) is None
        }
        return self.model_copy(update=limits)

    def requirements(self) -> tuple[Requirement, ...]:
        """Return one's own limits, and the preset's on whatever they do not speak of."""
        given = {metric: getattr(self, field) for field, metric in _METRIC_OF.items()}
        own = tuple(
            Requirement(metric, limit, way, None if metric in _NO_PERCENTILE else P99)
            for metric, limit in given.items()
            if limit is not None
            for way in _ways(metric)
        )
        if self.preset is None:
            return own
        rest = REQUIREMENTS[self.preset].requirements
        return own + tuple(one for one in rest if given.get(one.metric) is None)


def _ways(metric: Metric) -> tuple[Direction | None, ...]:
    return ("forward", "feedback") if metric in _EACH_WAY else (None,)
