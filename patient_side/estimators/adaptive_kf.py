"""`innovations_kf` that adapts while it runs: scales of velocity and noise, tracked on its own errors.

A model is fitted to other hands. This hand may go on for longer than they do, or err more: each forecast is kept
until the arm's samples around its instant have arrived, and compared with them. Two factors follow, for lags within
each octave:

- the *velocity's*, on the forecast move d: least squares of the true moves on the forecast ones, with exponential
  forgetting (Ljung 1999, *System Identification*, 11.2), and a prior of `_PRIOR_TICKS` forecasts that were right;
- the *noise's*, on the covariance: raised after an error outside the 95 % ellipsoid and lowered a little after one
  within, so that in the long run 95 % lie within, whatever the errors' distribution (Gibbs and Candes 2021,
  "Adaptive conformal inference under distribution shift").

The memory is bounded: 155 forecasts, 30 of each second, and four numbers an octave. A forecast waits a second for
samples around it that are late, and is dropped then. Oracles in test_adaptation: least squares with weights, and the
share within.

The estimator is off unless a scenario names it.
"""

from dataclasses import dataclass, field
from math import exp
from typing import NamedTuple

import numpy as np

from tis.common.metrics.consistency import CHI2_3_95
from tis.common.units import NS_PER_S
from tis.patient_side.estimators.innovations_kf import InnovationsKf, InnovationsState
from tis.patient_side.estimators.protocol import Estimate
from tis.patient_side.filters.innovations_filter import AXES
from tis.patient_side.horizon import HORIZON_S, horizon_samples
from tis.patient_side.linear_system import Array
from tis.patient_side.playout import Playout
from tis.patient_side.statespace import ArmModel

_REMEMBERED_S = 60.0
_PRIOR_TICKS = 300.0
_CHECKS_PER_S = 30
# One more than 30 a second: ticks of 30 Hz are rounded to whole ns.
_MAX_WAITING = (_CHECKS_PER_S + 1) * HORIZON_S
_LATE_S = 1
"""Time for which a forecast waits for samples around its instant while later ones have arrived."""
_LARGEST_VELOCITY = 1.5
"""The velocity's factor lies between 1/1.5 and 1.5."""
_NOISE_STEP = 0.02
_LARGEST_LOG_NOISE = 4.0
_OUTSIDE = 0.05


class Scales(NamedTuple):
    """Knowledge of the forecasts over the lags of one octave; the first three are sums, with forgetting.

    ``product``: the forecast move times the true one, m^2. ``square``: the forecast move's square, m^2. ``weight``: 1
    for each forecast. ``log_noise``: the logarithm of the noise's factor.
    """

    product: float = 0.0
    square: float = 0.0
    weight: float = 0.0
    log_noise: float = 0.0

    @property
    def velocity(self) -> float:
        """Factor on the forecast move."""
        if self.square <= 0.0:
            return 1.0
        found = (self.weight * self.product / self.square + _PRIOR_TICKS) / (self.weight + _PRIOR_TICKS)
        return min(_LARGEST_VELOCITY, max(1.0 / _LARGEST_VELOCITY, found))

    @property
    def noise(self) -> float:
        """Factor on the covariance."""
        return exp(self.log_noise)


class Forecast(NamedTuple):
    """A forecast that awaits the truth, between ``sample`` and the next, at ``fraction`` of the way.

    ``from_m`` (3,) is where the arm was last seen, ``move_m`` the model's forecast of its move since, ``position_m``
    the estimate and ``covariance_m2`` (3, 3) its covariance, as issued.
    """

    sample: int
    fraction: float
    octave: int
    from_m: Array
    move_m: Array
    position_m: Array
    covariance_m2: Array


class Adaptation(NamedTuple):
    """State: forecasts that await the truth, oldest first, scales by octave, and the instant to keep the next one."""

    waiting: tuple[Forecast, ...] = ()
    scales: tuple[Scales, ...] = ()
    next_ns: int = 0

    def scales_of(self, octave: int) -> Scales:
        """Return the scales of an octave of lags, of which nothing may be known yet."""
        return self.scales[octave] if octave < len(self.scales) else Scales()


def octave_of(lag_samples: float) -> int:
    """Return the octave of a lag: 0 below one sample, 1 below two, 2 below four."""
    return int(max(0.0, lag_samples)).bit_length()


@dataclass(frozen=True)
class Adapter:
    """The rules of adaptation for ticks and samples at ``rate_hz``."""

    rate_hz: int

    def checked(self, state: Adaptation, playout: Playout) -> Adaptation:
        """Return the state after the forecasts whose truth is known by now."""
        waiting, arm = state.waiting, playout.arm
        if not waiting or waiting[0].sample >= arm.newest:
            return state
        scales = list(state.scales)
        still: list[Forecast] = []
        oldest = arm.newest - _LATE_S * self.rate_hz
        for i, forecast in enumerate(waiting):
            # The forecasts are in order: no truth is known of the rest.
            if forecast.sample >= arm.newest:
                still += waiting[i:]
                break
            before, after = arm.get(forecast.sample), arm.get(forecast.sample + 1)
            if before is None or after is None:
                if forecast.sample >= oldest:
                    still.append(forecast)
                continue
            truth = before + forecast.fraction * (after - before)
            scales += [Scales()] * (forecast.octave + 1 - len(scales))
            scales[forecast.octave] = self._after(scales[forecast.octave], forecast, truth)
        return Adaptation(tuple(still), tuple(scales), state.next_ns)

    def _after(self, scales: Scales, forecast: Forecast, truth_m: Array) -> Scales:
        """Return the scales after a forecast and its truth (3,)."""
        kept = 1.0 - 1.0 / (_REMEMBERED_S * min(self.rate_hz, _CHECKS_PER_S))
        move, error = forecast.move_m, truth_m - forecast.position_m
        distance = float(error.dot(np.linalg.solve(forecast.covariance_m2, error)))
        step = _NOISE_STEP * ((1.0 if distance > CHI2_3_95 else 0.0) - _OUTSIDE)
        return Scales(
            kept * scales.product + float(move.dot(truth_m - forecast.from_m)),
            kept * scales.square + float(move.dot(move)),
            kept * scales.weight + 1.0,
            min(_LARGEST_LOG_NOISE, max(-_LARGEST_LOG_NOISE, scales.log_noise + step)),
        )

    def kept(self, state: Adaptation, forecast: Forecast, now_ns: int) -> Adaptation:
        """Return the state with a forecast of ``now_ns`` that awaits the truth, if one is due."""
        if now_ns < state.next_ns:
            return state
        waiting = (*state.waiting, forecast)[-_MAX_WAITING:]
        return Adaptation(waiting, state.scales, now_ns + NS_PER_S // (_CHECKS_PER_S + 1))


class AdaptiveState(NamedTuple):
    """The filter's state and the adaptation's."""

    filter: InnovationsState
    adaptation: Adaptation


@dataclass(frozen=True)
class AdaptiveKf:
    """The estimate of `InnovationsKf`, its move and its covariance scaled.

    Without a lag there is no move, and beyond the horizon (5 s, at most 2000 samples) nothing is adapted.
    """

    model: ArmModel
    name: str = "adaptive_kf"
    _filter: InnovationsKf = field(init=False, repr=False)
    _adapter: Adapter = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_filter", InnovationsKf(self.model))
        object.__setattr__(self, "_adapter", Adapter(self.model.rate_hz))

    def initial(self) -> AdaptiveState:
        """Return the state before the first arrival."""
        return AdaptiveState(self._filter.initial(), Adaptation())

    def step(self, state: AdaptiveState, playout: Playout, now_ns: int) -> tuple[AdaptiveState, Estimate]:
        """Return the state after what has arrived, and the estimate for ``now_ns``."""
        filtered, estimate = self._filter.step(state.filter, playout, now_ns)
        adaptation = self._adapter.checked(state.adaptation, playout)
        if estimate.position_m is None or estimate.covariance_m2 is None:
            return AdaptiveState(filtered, adaptation), estimate
        # Where the arm was last seen, or would be by its command, and how long ago.
        newest = filtered.ring[-1]
        lag = playout.age_samples(newest.source_index, now_ns)
        if not 0 < lag < horizon_samples(playout.rate_hz):
            return AdaptiveState(filtered, adaptation), estimate
        from_m = newest.mean.ravel()[-AXES:]
        # The scaled estimate, kept until the truth is known.
        octave = octave_of(lag)
        scales = adaptation.scales_of(octave)
        move_m = estimate.position_m - from_m
        position_m = from_m + scales.velocity * move_m
        covariance_m2 = scales.noise * estimate.covariance_m2
        index, rest = divmod(now_ns * playout.rate_hz, NS_PER_S)
        at = index, rest / NS_PER_S, octave
        forecast = Forecast(*at, from_m, move_m, position_m, covariance_m2)
        adaptation = self._adapter.kept(adaptation, forecast, now_ns)
        return AdaptiveState(filtered, adaptation), Estimate(position_m, covariance_m2)
