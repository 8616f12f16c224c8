"""Limits that a run is judged by, beside the usual requirements: user-defined ones, or those of one application."""

from typing import Final, Self

from pydantic import Field

from tis.common.channels import Direction
from tis.common.scenario.base import NonNegative, Part, Positive
from tis.common.scenario.requirements import P99, REQUIREMENTS, Application, Metric, Requirement

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
    """Limits of the run; the summary's verdicts state whether they are met. They change no exit code."""

    preset: Application | None = Field(
        None,
        description="Limits that the literature states for an application; limits given beside it take precedence. "
        + "; ".join(f"{name}: {needed.source}" for name, needed in REQUIREMENTS.items())
        + ".",
    )
    end_to_end_p99_ms: Positive | None = Field(
        None,
        description="Upper limit of the 99th percentile of the end-to-end latency, from a sample's instant to the "
        "published estimate, in ms. Any limit that is not given is the preset's, if it has one.",
    )
    one_way_p99_ms: Positive | None = Field(
        None, description="Upper limit of the 99th percentile of the network's one-way delay, in ms, per direction."
    )
    round_trip_p99_ms: Positive | None = Field(
        None,
        description="Upper limit of the 99th percentile of the round trip, in ms: from a command to its first "
        "feedback on the surgeon's clock, the wait for the patient's tick included.",
    )
    pdv_p99_ms: Positive | None = Field(
        None,
        description="Upper limit of the 99th percentile of the packet delay variation, the one-way delay above the "
        "smallest (PDV, RFC 5481), in ms, per direction.",
    )
    age_p99_ms: Positive | None = Field(
        None, description="Upper limit of the 99th percentile of the freshest sample's age at the ticks, in ms."
    )
    loss_max_pct: NonNegative | None = Field(
        None,
        le=100,
        description="Upper limit of the share of packets lost, in %, per direction; each copy of a sample counts as "
        "a packet. 0: no packet of this run may be lost.",
    )
    rmse_3d_max_mm: Positive | None = Field(
        None, description="Upper limit of the 3D root mean square error of the active estimator's position, in mm."
    )

    def resolved(self) -> Self:
        """Return the limits, completed by those of the preset."""
        if self.preset is None:
            return self
        # A preset may require different values per direction; a limit applies to both, so the smaller one counts.
        needed = [one for one in REQUIREMENTS[self.preset].requirements if one.binding]
        limits = {
            field: min((one.limit for one in needed if one.metric == metric), default=None)
            for field, metric in _METRIC_OF.items()
            if getattr(self, field) is None
        }
        return self.model_copy(update=limits)

    def requirements(self) -> tuple[Requirement, ...]:
        """Return the given limits, and the preset's requirements on all other metrics."""
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
