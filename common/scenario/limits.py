"""What a run is held against: limits of one's own, or those that an application is said to need."""

from typing import Final, Literal, NamedTuple, Self

from pydantic import Field

from common.scenario.base import NonNegative, Part, Positive

Preset = Literal["haptics", "augmented_reality", "immersive_reality", "tactile_internet", "remote_laparoscopy"]


class Requirement(NamedTuple):
    """What a preset stands for: the upper end of its delay, 100 % less its reliability, and who says so."""

    end_to_end_p99_ms: float
    loss_max_pct: float | None
    source: str


_PAPER: Final = "the paper's table of requirements"

PRESETS: Final[dict[Preset, Requirement]] = {
    "haptics": Requirement(2.0, 0.1, f"{_PAPER}: 0.5-2 ms, 99.9 %"),
    "augmented_reality": Requirement(2.0, 0.001, f"{_PAPER}: 0.5-2 ms, 99.999 %"),
    "immersive_reality": Requirement(2.0, 0.1, f"{_PAPER}: 0.5-2 ms, 99.9 %"),
    "tactile_internet": Requirement(10.0, 1e-5, "the usual statement for the Tactile Internet: 1-10 ms, 99.99999 %"),
    "remote_laparoscopy": Requirement(
        50.0, None, "requirements for remote laparoscopy: downlink below 50 ms; no reliability stated"
    ),
}


class Limits(Part):
    """What the run is held against; a limit that is missed shows in the summary."""

    preset: Preset | None = Field(
        None,
        description="Limits that an application is said to need; numbers given beside it take precedence. "
        + "; ".join(f"{name}: {requirement.source}" for name, requirement in PRESETS.items())
        + ".",
    )
    end_to_end_p99_ms: Positive | None = Field(
        None,
        description="Largest 99th percentile of the end-to-end latency; not given: the preset's, if there is one.",
    )
    loss_max_pct: NonNegative | None = Field(
        None,
        le=100,
        description="Largest share of messages lost, per link; not given: the preset's, if it has one.",
    )

    def resolved(self) -> Self:
        """Return the limits with the preset's numbers where none are given."""
        if self.preset is None:
            return self
        requirement = PRESETS[self.preset]
        latency_ms, loss_pct = self.end_to_end_p99_ms, self.loss_max_pct
        return self.model_copy(
            update={
                "end_to_end_p99_ms": requirement.end_to_end_p99_ms if latency_ms is None else latency_ms,
                "loss_max_pct": requirement.loss_max_pct if loss_pct is None else loss_pct,
            }
        )
