"""The forecast over a lag: what weighs the filter's mean, and the covariance that is owned up to."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from common.units import NS_PER_S
from patient_side.innovations_filter import InnovationsFilter
from patient_side.statespace import Array, InnovationsModel
from patient_side.unbroken import Unbroken

_MOST_KEPT = 64


class LagForecast(NamedTuple):
    """The position is ``weights`` (3, N) times the mean; its covariance is ``spread`` (3, 3), m^2."""

    weights: Array
    spread: Array


@dataclass(frozen=True, eq=False)
class LagForecasts:
    """Forecasts by their lag in ns, as far as the filter's horizon; beyond it they stay what they are there.

    ``scale`` (H + 2,) is the model's `covariance_scale` for each number of samples. In a steady network one tick asks
    for what the last one asked for: after an unbroken row, where no data change it, the forecast is kept.
    """

    filter: InnovationsFilter
    unbroken: Unbroken
    rate_hz: int
    scale: tuple[float, ...]
    _kept: dict[int, tuple[int, LagForecast]] = field(init=False, repr=False, default_factory=dict)

    @classmethod
    def of(
        cls, model: InnovationsModel, filter_: InnovationsFilter, unbroken: Unbroken, rate_hz: int
    ) -> "LagForecasts":
        """Return the forecasts of a model by its filter; between its horizons the scale is linear."""
        steps = np.arange(filter_.horizon + 2)
        scale = np.interp(steps, model.scale_horizons, model.covariance_scale)
        return cls(filter_, unbroken, rate_hz, tuple(scale.tolist()))

    def after_unbroken(self, length: int, lag_ns: int) -> LagForecast:
        """Return the forecast ``lag_ns`` after an unbroken row of ``length`` samples."""
        stage = self.unbroken.stage(length)
        kept = self._kept.get(lag_ns)
        if kept is not None and kept[0] == stage:
            return kept[1]
        forecast = self.after(self.unbroken.covariances[stage], lag_ns)
        forecast.spread.flags.writeable = False
        if len(self._kept) >= _MOST_KEPT:
            self._kept.clear()
        self._kept[lag_ns] = (stage, forecast)
        return forecast

    def after(self, covariance: Array, lag_ns: int) -> LagForecast:
        """Return the forecast ``lag_ns`` after a sample that left the covariance (N, N)."""
        steps, rest = divmod(lag_ns * self.rate_hz, NS_PER_S)
        fraction = rest / NS_PER_S
        if steps >= self.filter.horizon:
            steps, fraction = self.filter.horizon, 0.0
        weights = self.filter.weights(steps, fraction)
        spread = self.filter.spread(covariance, weights, steps, fraction)
        spread *= (1.0 - fraction) * self.scale[steps] + fraction * self.scale[steps + 1]
        return LagForecast(weights, spread)
