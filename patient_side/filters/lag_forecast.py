"""The forecast over a lag: the map from the filter's mean to the position, and the calibrated covariance."""

from dataclasses import dataclass, field
from math import sqrt
from typing import NamedTuple

import numpy as np

from tis.common.units import NS_PER_S
from tis.patient_side.filters.correction import CorrectionForecasts, LagCorrection
from tis.patient_side.filters.innovations_filter import AXES, InnovationsFilter
from tis.patient_side.filters.unbroken import Unbroken
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import InnovationsModel

_MAX_KEPT = 500
_LAG_MASK_NS = ~63
"""Lags have a resolution of 64 ns: sample instants are whole ns, so that one delay leads to several lags."""


class LagForecast(NamedTuple):
    """A position, ``weights`` (d, M) times the mean or the ``correction``'s, and its covariance ``spread`` (3, 3)."""

    weights: Array
    spread: Array
    correction: LagCorrection | None


class Lag(NamedTuple):
    """The data-independent part of a forecast: map (d, M), also scaled, and noise (d, d)."""

    weights: Array
    scaled: Array
    noise: Array
    correction: LagCorrection | None


@dataclass(frozen=True, eq=False)
class LagForecasts:
    """Forecasts by their lag in ns, up to the filter's horizon and constant beyond it.

    ``scale`` (H + 2,) is the model's `covariance_scale` for each number of samples, ``broken_scale`` the one after a
    broken row: the linear forecast's. In a steady network the ticks
    repeat the same lags, so the data-independent parts are cached.
    """

    filter: InnovationsFilter
    unbroken: Unbroken
    rate_hz: int
    scale: tuple[float, ...]
    broken_scale: tuple[float, ...]
    correction: CorrectionForecasts | None = None
    _lags: dict[tuple[int, bool], Lag] = field(init=False, repr=False, default_factory=dict)
    _kept: dict[tuple[int, int], LagForecast] = field(init=False, repr=False, default_factory=dict)

    @classmethod
    def of(
        cls, model: InnovationsModel, filter_: InnovationsFilter, unbroken: Unbroken, rate_hz: int
    ) -> "LagForecasts":
        """Return the forecasts of a model by its filter; the scale is interpolated linearly between its horizons."""
        steps = np.arange(filter_.horizon + 2)
        scale = broken_scale = np.interp(steps, model.scale_horizons, model.covariance_scale)
        correction = None
        if model.correction is not None:
            broken_scale = np.interp(steps, model.correction.horizons, model.correction.linear_scale)
            correction = CorrectionForecasts.of(model.correction, filter_)
        return cls(filter_, unbroken, rate_hz, tuple(scale.tolist()), tuple(broken_scale.tolist()), correction)

    def after_unbroken(self, length: int, lag_ns: int) -> LagForecast:
        """Return the forecast ``lag_ns`` after an unbroken row of ``length`` samples."""
        stage, lag_ns = self.unbroken.spread_stage(length), lag_ns & _LAG_MASK_NS
        kept = self._kept.get((stage, lag_ns))
        if kept is None:
            kept = self._forecast(self.unbroken.covariances[stage], lag_ns, broken=False)
            kept.spread.flags.writeable = False
            if len(self._kept) >= _MAX_KEPT:
                self._kept.clear()
            self._kept[stage, lag_ns] = kept
        return kept

    def after(self, covariance: Array, lag_ns: int) -> LagForecast:
        """Return the forecast ``lag_ns`` after a sample that left the covariance (M, M), in a broken row."""
        return self._forecast(covariance, lag_ns & _LAG_MASK_NS, broken=True)

    def _forecast(self, covariance: Array, lag_ns: int, *, broken: bool) -> LagForecast:
        lag = self._lags.get((lag_ns, broken))
        if lag is None:
            if len(self._lags) >= _MAX_KEPT:
                self._lags.clear()
            lag = self._lags[lag_ns, broken] = self._lag(lag_ns, self.broken_scale if broken else self.scale)
        spread = lag.scaled.dot(covariance).dot(lag.scaled.T)
        spread += lag.noise
        spread = spread if self.filter.n_axes == AXES else spread * self.filter.unit
        return LagForecast(lag.weights, spread, lag.correction)

    def _lag(self, lag_ns: int, scales: tuple[float, ...]) -> Lag:
        steps, rest = divmod(lag_ns * self.rate_hz, NS_PER_S)
        fraction = rest / NS_PER_S
        if steps >= self.filter.horizon:
            steps, fraction = self.filter.horizon, 0.0
        scale = (1.0 - fraction) * scales[steps] + fraction * scales[steps + 1]
        weights = self.filter.weights(steps, fraction)
        correction = None if self.correction is None else self.correction.at(weights, steps, fraction)
        return Lag(weights, sqrt(scale) * weights, scale * self.filter.noise(steps, fraction), correction)
