"""How late a message is: the distributions of one-way delay, the jitter about it, and its correlation in time."""

from itertools import pairwise
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from common.scenario.base import Milliseconds, Part, Probability

_WEIGHTS_MISS_1: float = 1e-6

Weight = Annotated[float, Field(gt=0)]
Extent = Annotated[float, Field(ge=1e-6, le=3_600_000)]  # 1 ns, the grain of delays, to an hour


class ConstantDelay(Part):
    """Every message is equally late."""

    kind: Literal["constant"] = Field(description="constant: the same delay for every message.")
    delay_ms: Milliseconds = Field(description="One-way delay, in ms.")


class UniformDelay(Part):
    """Delays are equally likely between two bounds."""

    kind: Literal["uniform"] = Field(description="uniform: between two bounds.")
    low_ms: Milliseconds = Field(description="Smallest one-way delay, in ms.")
    high_ms: Milliseconds = Field(description="Largest one-way delay, in ms.")

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.high_ms < self.low_ms:
            raise ValueError(f"high_ms must be at least low_ms = {self.low_ms}")
        return self


class NormalDelay(Part):
    """Normally distributed delays; negative ones are redrawn (the distribution is truncated at 0)."""

    kind: Literal["normal"] = Field(description="normal: mean and standard deviation.")
    mean_ms: Milliseconds = Field(description="Mean of the normal distribution before truncation, in ms.")
    std_ms: Milliseconds = Field(description="Its standard deviation, in ms.")


class _Unbounded(Part):
    """A part that is never negative, with a tail that `max_ms` may end."""

    shift_ms: Milliseconds = Field(0.0, description="A constant delay that is added to every draw, in ms.")
    max_ms: Milliseconds = Field(
        3_600_000.0, description="Delays above this, shift included, are redrawn, in ms; an hour when not given."
    )

    def _extent_ms(self) -> float:
        """Return what has to find room between shift and maximum, so that not nearly every draw is redrawn."""
        raise NotImplementedError

    @model_validator(mode="after")
    def _has_room(self) -> Self:
        least_ms = self.shift_ms + self._extent_ms()
        if self.max_ms < least_ms:
            raise ValueError(f"max_ms must be at least {least_ms:g}, or nearly all delays would be redrawn")
        return self


class _Moments(_Unbounded):
    """A part by its mean and standard deviation."""

    mean_ms: Extent = Field(description="Mean of the part that is added to the shift, in ms.")
    std_ms: Extent = Field(description="Its standard deviation, in ms.")

    def _extent_ms(self) -> float:
        return self.mean_ms


class LognormalDelay(_Moments):
    """A shift plus a lognormal part."""

    kind: Literal["lognormal"] = Field(description="lognormal: a shift plus a lognormal part.")


class GammaDelay(_Moments):
    """A shift plus a gamma part; with ``std_ms`` equal to ``mean_ms`` it is exponential."""

    kind: Literal["gamma"] = Field(description="gamma: a shift plus a gamma part.")


class ParetoDelay(_Unbounded):
    """A shift plus a Pareto II (Lomax) part: P(X > x) = (1 + x / scale) ** -shape. Shift = scale is Pareto I."""

    kind: Literal["pareto"] = Field(description="pareto: a shift plus a Pareto II (Lomax) part.")
    scale_ms: Extent = Field(description="Scale of the tail, in ms.")
    shape: Annotated[float, Field(ge=0.05, le=1_000)] = Field(
        description="Tail index; max_ms alone ends the mean at or below 1, the variance at or below 2."
    )

    def _extent_ms(self) -> float:
        return self.scale_ms


class HyperexponentialDelay(_Unbounded):
    """A shift plus a mixture of exponentials: with each weight, an exponential of that mean."""

    kind: Literal["hyperexponential"] = Field(description="hyperexponential: a shift plus a mixture of exponentials.")
    weights: tuple[Weight, ...] = Field(min_length=1, max_length=16, description="Probability of each; sums to 1.")
    means_ms: tuple[Extent, ...] = Field(min_length=1, max_length=16, description="Mean of each, in ms.")

    def _extent_ms(self) -> float:
        return sum(weight * mean_ms for weight, mean_ms in zip(self.weights, self.means_ms, strict=False))

    @model_validator(mode="after")
    def _pairs(self) -> Self:
        if len(self.weights) != len(self.means_ms):
            raise ValueError(f"means_ms must have as many items as weights, {len(self.weights)}")
        if abs(sum(self.weights) - 1) > _WEIGHTS_MISS_1:
            raise ValueError("weights must sum to 1")
        return self


class Quantile(Part):
    """A point of a distribution function."""

    p: Probability = Field(description="Share of the delays that are at most delay_ms, 0 to 1.")
    delay_ms: Milliseconds = Field(description="The quantile, in ms.")


class QuantileDelay(Part):
    """An empirical distribution: straight lines between the quantiles given."""

    kind: Literal["quantiles"] = Field(description="quantiles: straight lines between points of the distribution.")
    points: tuple[Quantile, ...] = Field(
        min_length=2, max_length=10_000, description="Ascending, the first at p = 0, the last at p = 1."
    )

    @model_validator(mode="after")
    def _ascending(self) -> Self:
        faults = []
        if self.points[0].p != 0 or self.points[-1].p != 1:
            faults.append("points must begin at p = 0 and end at p = 1")
        if any(b.p <= a.p or b.delay_ms < a.delay_ms for a, b in pairwise(self.points)):
            faults.append("points must ascend, p strictly")
        if faults:
            raise ValueError("\n".join(faults))
        return self


class TraceDelay(Part):
    """The delays of a recorded trace, one after the other; rows that were lost have none and are skipped."""

    kind: Literal["trace"] = Field(description="trace: the delays of a recorded trace.")
    path: str = Field(min_length=1, description="CSV file, as tis net probe writes it.")
    advance: Literal["packet", "time"] = Field(
        "packet", description="packet: each message takes the next row; time: the row of its run time."
    )


class NormalJitter(Part):
    """A normal deviation added to the delay; redrawn where the sum would be negative."""

    kind: Literal["normal"] = Field(description="normal: a standard deviation about the delay.")
    std_ms: Milliseconds = Field(description="Standard deviation, in ms.")


class UniformJitter(Part):
    """A uniform deviation added to the delay; redrawn where the sum would be negative."""

    kind: Literal["uniform"] = Field(description="uniform: within plus and minus a half width.")
    half_width_ms: Milliseconds = Field(description="The deviation lies within plus and minus this, in ms.")


class Correlation(Part):
    """Delays of neighbouring moments resemble each other: a Gaussian-copula Ornstein-Uhlenbeck process.

    The distribution of the delays stays as asked, whatever the message rate.
    """

    half_life_s: Annotated[float, Field(ge=0.001, le=86_400)] = Field(
        description="Time after which the correlation of the Gaussian scores has fallen to one half, in s."
    )
    across_keys: bool = Field(False, description="true: all keys of the direction share one process.")


Delay = Annotated[
    ConstantDelay
    | UniformDelay
    | NormalDelay
    | LognormalDelay
    | GammaDelay
    | ParetoDelay
    | HyperexponentialDelay
    | QuantileDelay
    | TraceDelay,
    Field(discriminator="kind"),
]
Jitter = Annotated[NormalJitter | UniformJitter, Field(discriminator="kind")]
