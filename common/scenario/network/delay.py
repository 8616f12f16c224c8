"""One-way delay of messages: its distributions, the jitter about it, and its correlation in time."""

from itertools import pairwise
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from tis.common.scenario.base import Advance, Milliseconds, Part, Probability, TraceFile, refuse

_WEIGHT_SUM_TOLERANCE: float = 1e-6

Weight = Annotated[float, Field(gt=0)]
Extent = Annotated[float, Field(ge=1e-6, le=3_600_000)]  # in ms: from 1 ns, the resolution of delays, to an hour


class ConstantDelay(Part):
    """The same delay for every message."""

    kind: Literal["constant"] = Field(description="constant: the same delay for every message.")
    delay_ms: Milliseconds = Field(description="One-way delay, in ms.")


class UniformDelay(Part):
    """Delays uniformly distributed between two bounds."""

    kind: Literal["uniform"] = Field(description="uniform: equally likely between two bounds.")
    low_ms: Milliseconds = Field(description="Smallest one-way delay, in ms.")
    high_ms: Milliseconds = Field(description="Largest one-way delay, in ms.")

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.high_ms < self.low_ms:
            raise ValueError(f"high_ms must be at least low_ms = {self.low_ms}")
        return self


class NormalDelay(Part):
    """Normally distributed delays; negative ones are redrawn (the distribution is truncated at 0)."""

    kind: Literal["normal"] = Field(description="normal: a normal distribution, truncated at 0.")
    mean_ms: Milliseconds = Field(description="Mean of the normal distribution before truncation, in ms.")
    std_ms: Milliseconds = Field(description="Standard deviation before truncation, in ms.")


class _Unbounded(Part):
    """A constant shift plus a random part >= 0, whose tail `max_ms` truncates."""

    shift_ms: Milliseconds = Field(0.0, description="Constant delay that is added to every draw, in ms.")
    max_ms: Milliseconds = Field(
        3_600_000.0, description="Maximum delay, shift included, in ms; larger draws are redrawn. Default: an hour."
    )

    def _extent_ms(self) -> float:
        """Return the least distance of maximum and shift, below which nearly every draw would be redrawn."""
        raise NotImplementedError

    @model_validator(mode="after")
    def _has_room(self) -> Self:
        least_ms = self.shift_ms + self._extent_ms()
        if self.max_ms < least_ms:
            raise ValueError(f"max_ms must be at least {least_ms:g}, or nearly all delays would be redrawn")
        return self


class _Moments(_Unbounded):
    """A random part by its mean and standard deviation."""

    mean_ms: Extent = Field(description="Mean of the random part, without the shift, in ms.")
    std_ms: Extent = Field(description="Standard deviation of the random part, in ms.")

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
    scale_ms: Extent = Field(description="Scale of the Pareto part, in ms.")
    shape: Annotated[float, Field(ge=0.05, le=1_000)] = Field(
        description="Tail index; up to 1 the mean is finite by max_ms only, up to 2 the variance."
    )

    def _extent_ms(self) -> float:
        return self.scale_ms


class HyperexponentialDelay(_Unbounded):
    """A shift plus a mixture of exponential distributions."""

    kind: Literal["hyperexponential"] = Field(description="hyperexponential: a shift plus a mixture of exponentials.")
    weights: tuple[Weight, ...] = Field(
        min_length=1, max_length=16, description="Probability of each exponential; they sum to 1."
    )
    means_ms: tuple[Extent, ...] = Field(min_length=1, max_length=16, description="Mean of each exponential, in ms.")

    def _extent_ms(self) -> float:
        return sum(weight * mean_ms for weight, mean_ms in zip(self.weights, self.means_ms, strict=False))

    @model_validator(mode="after")
    def _pairs(self) -> Self:
        if len(self.weights) != len(self.means_ms):
            raise ValueError(f"means_ms must have as many items as weights, {len(self.weights)}")
        if abs(sum(self.weights) - 1) > _WEIGHT_SUM_TOLERANCE:
            raise ValueError("weights must sum to 1")
        return self


class Quantile(Part):
    """A point of a distribution function."""

    p: Probability = Field(description="Probability that a delay is at most delay_ms, 0 to 1.")
    delay_ms: Milliseconds = Field(description="Delay at this probability, in ms.")


class QuantileDelay(Part):
    """An empirical distribution, linear between the given quantiles."""

    kind: Literal["quantiles"] = Field(description="quantiles: a distribution that is linear between given points.")
    points: tuple[Quantile, ...] = Field(
        min_length=2, max_length=10_000, description="Quantiles in ascending order, from p = 0 to p = 1."
    )

    @model_validator(mode="after")
    def _ascending(self) -> Self:
        faults = []
        if self.points[0].p != 0 or self.points[-1].p != 1:
            faults.append("points must begin at p = 0 and end at p = 1")
        if any(b.p <= a.p or b.delay_ms < a.delay_ms for a, b in pairwise(self.points)):
            faults.append("points must have strictly ascending p and no descending delay_ms")
        refuse(faults)
        return self


class TraceDelay(Part):
    """The delays of a recorded trace in their order; rows of lost messages are skipped."""

    kind: Literal["trace"] = Field(description="trace: the delays of a recorded trace.")
    path: TraceFile
    advance: Advance = "packet"


class NormalJitter(Part):
    """A normal deviation added to the delay; redrawn where the sum would be negative."""

    kind: Literal["normal"] = Field(description="normal: a normal deviation about the delay.")
    std_ms: Milliseconds = Field(description="Standard deviation, in ms.")


class UniformJitter(Part):
    """A uniform deviation added to the delay; redrawn where the sum would be negative."""

    kind: Literal["uniform"] = Field(description="uniform: a uniform deviation about the delay.")
    half_width_ms: Milliseconds = Field(description="Largest deviation in either direction, in ms.")


class Correlation(Part):
    """Correlation of delays in time, by an Ornstein-Uhlenbeck process and a Gaussian copula.

    The delays keep the requested distribution at any message rate.
    """

    half_life_s: Annotated[float, Field(ge=0.001, le=86_400)] = Field(
        description="Time in which the correlation of the Gaussian scores halves, in s."
    )
    across_keys: bool = Field(
        False, description="true: all keys of the direction share one process; false: each key has its own."
    )
    shared: Probability = Field(
        0.0,
        description="Correlation between the scores of both directions, 0 to 1, where both give it and half_life_s "
        "alike. 1: all messages of both ways share one process, so both are long together, as in a round trip.",
    )


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
