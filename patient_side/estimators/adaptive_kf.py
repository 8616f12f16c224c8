"""`innovations_kf`: the filter, and while it runs two scales, of velocity and noise, tracked on its own errors.

A model is fitted to other hands. This hand may go on for longer than they do, or err more: each forecast is kept
until the arm's samples around its instant have arrived, and compared with them. Two factors follow, for lags within
each octave:

- the *velocity's*, on the forecast move d: least squares of the true moves on the forecast ones, with exponential
  forgetting (Ljung 1999, *System Identification*, 11.2), and a prior of `_PRIOR_TICKS` forecasts that were right;
- the *noise's*, on the covariance: raised after an error outside the 95 % ellipsoid and lowered a little after one
  within, so that in the long run 95 % lie within, whatever the errors' distribution (Gibbs and Candes 2021,
  "Adaptive conformal inference under distribution shift").

Lags longer than all that have been checked, as those of an outage whose samples never arrive, have half of the
logarithm of the noise's factor at the longest that has been: part of it is the hand's at every lag.

The memory is bounded: 55 forecasts, 10 of each second, and six numbers an octave. A forecast waits a second for
samples around it that are late, and is dropped then. Oracles in test_adaptation: least squares with weights, and the
share within.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import exp, sqrt
from typing import NamedTuple

from tis.common.metrics.consistency import CHI2_3_95
from tis.common.units import NS_PER_S, sample_instant_ns
from tis.patient_side.estimators.innovations_kf import InnovationsKf, InnovationsState
from tis.patient_side.estimators.protocol import Estimate
from tis.patient_side.horizon import HORIZON_S, horizon_samples
from tis.patient_side.linear_system import Array
from tis.patient_side.playout import Playout
from tis.patient_side.statespace import ArmModel

Three = Sequence[float]
_REMEMBERED_S = 60.0
_PRIOR_TICKS = 300.0
_CHECKS_PER_S = 10
# One more than 10 a second: ticks are rounded to whole ns.
_MAX_WAITING = (_CHECKS_PER_S + 1) * HORIZON_S
_LATE_S = 1
"""Time for which a forecast waits for samples around its instant while later ones have arrived."""
_LARGEST_VELOCITY = 1.5
"""The velocity's factor lies between 1/1.5 and 1.5."""
_NOISE_STEP = 0.06
_LARGEST_LOG_NOISE = 4.0
_OUTSIDE = 0.05
_TINY = 1e-200
_INHERITED = 0.5
"""Share of the logarithm of the noise's factor that longer lags have from the longest that was checked."""


class Scales(NamedTuple):
    """Knowledge of the forecasts over the lags of one octave; the first three are sums, with forgetting.

    ``product``: the forecast move times the true one, m^2. ``square``: the forecast move's square, m^2. ``weight``: 1
    for each forecast. ``log_noise``: the logarithm of the noise's factor. ``velocity`` and ``noise`` are the factors
    on forecast move and covariance that follow.
    """

    product: float = 0.0
    square: float = 0.0
    weight: float = 0.0
    log_noise: float = 0.0
    velocity: float = 1.0
    noise: float = 1.0

    @classmethod
    def of(cls, product: float = 0.0, square: float = 0.0, weight: float = 0.0, log_noise: float = 0.0) -> "Scales":
        """Return what is known, with the factors."""
        velocity = 1.0
        if square > 0.0:
            velocity = (weight * product / square + _PRIOR_TICKS) / (weight + _PRIOR_TICKS)
            velocity = min(_LARGEST_VELOCITY, max(1.0 / _LARGEST_VELOCITY, velocity))
        return cls(product, square, weight, log_noise, velocity, exp(log_noise))


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
        if octave < len(self.scales):
            return self.scales[octave]
        return Scales.of(log_noise=_INHERITED * self.scales[-1].log_noise) if self.scales else Scales()


def octave_of(lag_ns: int, rate_hz: int) -> int:
    """Return the octave of a lag: 0 below one sample, 1 below two, 2 below four."""
    return (lag_ns * rate_hz // NS_PER_S).bit_length() if lag_ns > 0 else 0


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
            octave = forecast.octave
            if octave >= len(scales):
                inherited = Adaptation((), tuple(scales)).scales_of(octave)
                scales += [inherited] * (octave + 1 - len(scales))
            scales[octave] = self._after(scales[octave], forecast, before.tolist(), after.tolist())
        return Adaptation(tuple(still), tuple(scales), state.next_ns)

    def _after(self, scales: Scales, forecast: Forecast, before_m: Three, after_m: Three) -> Scales:
        """Return the scales after a forecast and the arm's samples around its instant."""
        # Plain numbers: on three of them Python is faster than numpy.
        kept, share = 1.0 - 1.0 / (_REMEMBERED_S * min(self.rate_hz, _CHECKS_PER_S)), forecast.fraction
        (bx, by, bz), (ax, ay, az) = before_m, after_m
        x, y, z = bx + share * (ax - bx), by + share * (ay - by), bz + share * (az - bz)
        (fx, fy, fz), (mx, my, mz) = forecast.from_m.tolist(), forecast.move_m.tolist()
        px, py, pz = forecast.position_m.tolist()
        is_outside = _distance((x - px, y - py, z - pz), forecast.covariance_m2.tolist()) > CHI2_3_95
        step = _NOISE_STEP * ((1.0 if is_outside else 0.0) - _OUTSIDE)
        return Scales.of(
            kept * scales.product + mx * (x - fx) + my * (y - fy) + mz * (z - fz),
            kept * scales.square + mx * mx + my * my + mz * mz,
            kept * scales.weight + 1.0,
            min(_LARGEST_LOG_NOISE, max(-_LARGEST_LOG_NOISE, scales.log_noise + step)),
        )

    def kept(self, state: Adaptation, forecast: Forecast, now_ns: int) -> Adaptation:
        """Return the state with a forecast of ``now_ns`` that awaits the truth, if one is due."""
        if now_ns < state.next_ns:
            return state
        waiting = (*state.waiting, forecast)[-_MAX_WAITING:]
        return Adaptation(waiting, state.scales, now_ns + NS_PER_S // (_CHECKS_PER_S + 1))


def _distance(error: Three, covariance: list[list[float]]) -> float:
    """Return the squared distance of an error in units of a covariance (3, 3), by its triangular factor."""
    (a, b, c), (_, d, e), (_, _, f) = covariance
    x, y, z = error
    r = sqrt(max(a, _TINY))
    s, t = b / r, c / r
    u = sqrt(max(d - s * s, _TINY))
    v = (e - s * t) / u
    w = sqrt(max(f - t * t - v * v, _TINY))
    x /= r
    y = (y - s * x) / u
    z = (z - t * x - v * y) / w
    return x * x + y * y + z * z


AdaptiveState = tuple[InnovationsState, Adaptation]
"""The filter's state and the adaptation's."""


@dataclass(frozen=True)
class AdaptiveKf:
    """The estimate of `InnovationsKf`, its move and its covariance scaled.

    Without a lag there is no move, and beyond the horizon (5 s, at most 2000 samples) nothing is adapted.
    """

    model: ArmModel
    name: str = "innovations_kf"
    _filter: InnovationsKf = field(init=False, repr=False)
    _adapter: Adapter = field(init=False, repr=False)
    _horizon_ns: int = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_filter", InnovationsKf(self.model))
        object.__setattr__(self, "_adapter", Adapter(self.model.rate_hz))
        horizon_ns = sample_instant_ns(horizon_samples(self.model.rate_hz), self.model.rate_hz)
        object.__setattr__(self, "_horizon_ns", horizon_ns)

    def initial(self) -> AdaptiveState:
        """Return the state before the first arrival."""
        return self._filter.initial(), Adaptation()

    def step(self, state: AdaptiveState, playout: Playout, now_ns: int) -> tuple[AdaptiveState, Estimate]:
        """Return the state after what has arrived, and the estimate for ``now_ns``."""
        filtered, adaptation = state
        filtered, estimate = self._filter.step(filtered, playout, now_ns)
        rate_hz = self.model.rate_hz
        if adaptation.waiting and adaptation.waiting[0].sample < playout.arm.newest:
            adaptation = self._adapter.checked(adaptation, playout)
        position_m, covariance_m2 = estimate
        if position_m is None or covariance_m2 is None:
            return (filtered, adaptation), estimate
        # How long ago the arm was last seen, or would be by its command.
        newest = filtered.ring[-1]
        lag_ns = now_ns - sample_instant_ns(newest.source_index, rate_hz)
        if not 0 < lag_ns < self._horizon_ns:
            return (filtered, adaptation), estimate
        # The scaled estimate: in place, as the filter has made both arrays for this answer.
        octave = octave_of(lag_ns, rate_hz)
        try:
            scales = adaptation.scales[octave]
        except IndexError:  # nothing is known of it yet
            scales = adaptation.scales_of(octave)
        from_m = newest.mean[self._filter.place]
        position_m -= from_m
        is_due = now_ns >= adaptation.next_ns
        move_m = position_m.copy() if is_due else position_m
        position_m *= scales.velocity
        position_m += from_m
        covariance_m2 *= scales.noise
        if is_due:
            # Kept until the truth is known.
            index, rest = divmod(now_ns * rate_hz, NS_PER_S)
            at = index, rest / NS_PER_S, octave
            forecast = Forecast(*at, from_m, move_m, position_m, covariance_m2)
            adaptation = self._adapter.kept(adaptation, forecast, now_ns)
        return (filtered, adaptation), estimate
