"""`innovations_kf`: the filter, and while it runs three factors, of trust, velocity and noise, tracked on its errors.

A model is fitted to other hands. This one may go on for longer than they do or err more, or its device may be much
noisier than the training rows, as a mouse whose events stand still and jump. Each forecast is kept until the arm's
samples around its instant have arrived, and compared with them. Three factors follow, for lags within each octave:

- *trust*, on the way from the forecast of `damped_velocity` v to the filter's f. w is the least squares of y - v on
  f - v, with exponential forgetting by what has been learned and a prior of `_PRIOR_DOUBT` that f was right. Where
  w < 1/2 the filter errs by more than v, and the factor is (2 w)^4, else 1. Squares count in units of the
  covariance and up to `_MOST_DOUBT` of them: a single jump of the arm changes little;
- the *velocity's*, on the forecast move d: least squares of the true moves on the forecast ones, with exponential
  forgetting (Ljung 1999, *System Identification*, 11.2), and a prior of `_PRIOR_TICKS` forecasts that were right;
- the *noise's*, on the covariance: raised after an error outside the 95 % ellipsoid and lowered a little after one
  within, so that in the long run 95 % lie within, whatever the errors' distribution (Gibbs and Candes 2021,
  "Adaptive conformal inference under distribution shift"). The first steps are larger, as a hand that moves otherwise
  than the training's shows within seconds.

An outage's samples never arrive, so it would teach nothing. Longer lags than the present one are *rehearsed*: with a
forecast that is kept, one over up to 2 s is, of each longer octave in turn. As they come less often, each counts as
often in the noise's factor. Lags of which nothing has been checked have half of the logarithm of the noise's factor
at the longest that has been, as part of it is the hand's at every lag, and its trust.

The memory is bounded: 110 forecasts, 22 of each second, and nine numbers an octave. A forecast waits 5 s for samples
around it that are late, and is dropped then. Oracles in test_adaptation: least squares with weights, and the share
within.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import exp, sqrt
from operator import itemgetter
from typing import NamedTuple

from tis.common.metrics.consistency import CHI2_3_95
from tis.common.units import NS_PER_S, sample_instant_ns
from tis.patient_side.estimators.innovations_kf import InnovationsKf, InnovationsState
from tis.patient_side.estimators.protocol import Estimate
from tis.patient_side.filters.input_path import continued
from tis.patient_side.horizon import HORIZON_S, horizon_samples
from tis.patient_side.linear_system import Array
from tis.patient_side.playout import Playout
from tis.patient_side.statespace import ArmModel

Three = Sequence[float]
_REMEMBERED_S = 60.0
_PRIOR_TICKS = 300.0
_CHECKS_PER_S = 10
# One more than 10 a second: ticks are rounded to whole ns.
_MAX_WAITING = 2 * (_CHECKS_PER_S + 1) * HORIZON_S
_SAMPLE = itemgetter(0)
_REHEARSED_NS = 2 * NS_PER_S
"""Lag up to which forecasts are rehearsed."""
_LATE_S = HORIZON_S
"""Time for which a forecast waits for samples around its instant while later ones have arrived."""
_LARGEST_VELOCITY = 1.5
"""The velocity's factor lies between 1/1.5 and 1.5."""
_PRIOR_DOUBT = 10.0
_MOST_DOUBT = 10.0
_REMEMBERED_DOUBT = 1000.0
_NOISE_STEP = 0.06
_EARLY_STEP = 6.0
"""Part of the noise's step, in units of `_NOISE_STEP`, that is halved by the first `_EARLY_CHECKS` of an octave."""
_EARLY_CHECKS = 20.0
_LARGEST_LOG_NOISE = 8.0
_OUTSIDE = 0.05
_TINY = 1e-200
_INHERITED = 0.5
"""Share of the logarithm of the noise's factor that longer lags have from the longest that was checked."""


class Scales(NamedTuple):
    """Knowledge of the forecasts over the lags of one octave; but for ``log_noise`` these are sums, with forgetting.

    ``product``: the forecast move times the true one, m^2. ``square``: the forecast move's square, m^2. ``weight``: 1
    for each forecast. ``log_noise``: the logarithm of the noise's factor. ``agreed``: y - v times f - v, in units of
    the covariance, and ``apart`` the square of f - v. ``velocity``, ``noise`` and ``trust`` are the factors that
    follow.
    """

    product: float = 0.0
    square: float = 0.0
    weight: float = 0.0
    log_noise: float = 0.0
    agreed: float = 0.0
    apart: float = 0.0
    velocity: float = 1.0
    noise: float = 1.0
    trust: float = 1.0

    @classmethod
    def of(
        cls,
        product: float = 0.0,
        square: float = 0.0,
        weight: float = 0.0,
        log_noise: float = 0.0,
        agreed: float = 0.0,
        apart: float = 0.0,
    ) -> "Scales":
        """Return what is known, with the factors."""
        velocity = 1.0
        if square > 0.0:
            velocity = (weight * product / square + _PRIOR_TICKS) / (weight + _PRIOR_TICKS)
            velocity = min(_LARGEST_VELOCITY, max(1.0 / _LARGEST_VELOCITY, velocity))
        share = 2.0 * max(0.0, _PRIOR_DOUBT + agreed) / (_PRIOR_DOUBT + apart)
        return cls(product, square, weight, log_noise, agreed, apart, velocity, exp(log_noise), min(1.0, share**4))


class Forecast(NamedTuple):
    """A forecast that awaits the truth, between ``sample`` and the next, at ``fraction`` of the way.

    ``from_m`` (3,) is where the arm was last seen, ``move_m`` the trusted forecast of its move since, ``position_m``
    the estimate and ``covariance_m2`` (3, 3) its covariance, as issued. ``plain_m`` (3,) is v and ``apart_m`` f - v.
    A rehearsed one ``stands_for`` those of the other octaves in turn.
    """

    sample: int
    fraction: float
    octave: int
    from_m: Array
    move_m: Array
    position_m: Array
    covariance_m2: Array
    plain_m: Array
    apart_m: Array
    stands_for: int = 1


class Adaptation(NamedTuple):
    """State: forecasts that await the truth, oldest first, scales by octave, and the instant to keep the next one."""

    waiting: tuple[Forecast, ...] = ()
    scales: tuple[Scales, ...] = ()
    next_ns: int = 0

    def scales_of(self, octave: int) -> Scales:
        """Return the scales of an octave of lags, of which nothing may be known yet."""
        if octave < len(self.scales):
            return self.scales[octave]
        if not self.scales:
            return Scales()
        longest = self.scales[-1]
        return Scales.of(log_noise=_INHERITED * longest.log_noise, agreed=longest.agreed, apart=longest.apart)


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
        covariance = forecast.covariance_m2.tolist()
        is_outside = _distance((x - px, y - py, z - pz), covariance) > CHI2_3_95
        early = _EARLY_STEP / (1.0 + scales.weight / _EARLY_CHECKS) if forecast.stands_for == 1 else 0.0
        step = (forecast.stands_for + early) * _NOISE_STEP * ((1.0 if is_outside else 0.0) - _OUTSIDE)
        (vx, vy, vz), (dx, dy, dz) = forecast.plain_m.tolist(), forecast.apart_m.tolist()
        apart = dx * dx + dy * dy + dz * dz
        unit = max(covariance[0][0] + covariance[1][1] + covariance[2][2], apart / _MOST_DOUBT, _TINY)
        left = 1.0 - apart / unit / _REMEMBERED_DOUBT
        return Scales.of(
            kept * scales.product + mx * (x - fx) + my * (y - fy) + mz * (z - fz),
            kept * scales.square + mx * mx + my * my + mz * mz,
            kept * scales.weight + 1.0,
            min(_LARGEST_LOG_NOISE, max(-_LARGEST_LOG_NOISE, scales.log_noise + step)),
            left * scales.agreed + ((x - vx) * dx + (y - vy) * dy + (z - vz) * dz) / unit,
            left * scales.apart + apart / unit,
        )

    def kept(self, state: Adaptation, forecasts: Sequence[Forecast], now_ns: int) -> Adaptation:
        """Return the state with forecasts made at ``now_ns`` that await the truth, if some are due."""
        if now_ns < state.next_ns:
            return state
        waiting = tuple(sorted((*state.waiting, *forecasts), key=_SAMPLE)[-_MAX_WAITING:])
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
    _horizon: float = field(init=False, repr=False)
    _horizon_ns: int = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_filter", InnovationsKf(self.model))
        object.__setattr__(self, "_adapter", Adapter(self.model.rate_hz))
        object.__setattr__(self, "_horizon", float(horizon_samples(self.model.rate_hz)))
        horizon_ns = sample_instant_ns(horizon_samples(self.model.rate_hz), self.model.rate_hz)
        object.__setattr__(self, "_horizon_ns", horizon_ns)

    def initial(self) -> AdaptiveState:
        """Return the state before the first arrival."""
        return self._filter.initial(), Adaptation()

    def step(self, state: AdaptiveState, playout: Playout, now_ns: int) -> tuple[AdaptiveState, Estimate]:
        """Return the state after what has arrived, and the estimate for ``now_ns``."""
        before, adaptation = state
        filtered, estimate = self._filter.step(before, playout, now_ns)
        rate_hz = self.model.rate_hz
        if adaptation.waiting and adaptation.waiting[0].sample < playout.arm.newest:
            adaptation = self._adapter.checked(adaptation, playout)
        position_m, covariance_m2 = estimate
        if position_m is None or covariance_m2 is None:
            return (filtered, adaptation), estimate
        # How long ago the arm was last seen, or would be by its command.
        newest = filtered.ring[-1]
        lag_ns = now_ns - newest.source_index * NS_PER_S // rate_hz  # no call, as at each tick
        if not 0 < lag_ns < self._horizon_ns:
            return (filtered, adaptation), estimate
        # The scaled estimate: in place, as the filter has made both arrays for this answer.
        is_due = now_ns >= adaptation.next_ns
        issued = self._issued(filtered, adaptation, playout, position_m, covariance_m2, now_ns, lag_ns, is_due)
        if issued is not None:
            # Kept until the truth is known; after a new sample with one over a longer lag.
            kept = [issued]
            if filtered.n_arm > before.n_arm:
                kept += self._rehearsed(filtered, adaptation, playout, issued.octave, now_ns)
            adaptation = self._adapter.kept(adaptation, kept, now_ns)
        return (filtered, adaptation), estimate

    def _issued(
        self,
        filtered: InnovationsState,
        adaptation: Adaptation,
        playout: Playout,
        position_m: Array,
        covariance_m2: Array,
        now_ns: int,
        lag_ns: int,
        is_kept: bool,
    ) -> Forecast | None:
        """Scale the filter's estimate for ``now_ns`` in place, and return the forecast if it is to be kept."""
        rate_hz = self.model.rate_hz
        octave = (lag_ns * rate_hz // NS_PER_S).bit_length()
        try:
            scales = adaptation.scales[octave]
        except IndexError:  # nothing is known of it yet
            scales = adaptation.scales_of(octave)
        from_m = filtered.ring[-1].mean[self._filter.place]
        plain_m = apart_m = from_m
        if is_kept or scales.trust < 1.0:
            plain_m = position_m if playout.arm.newest < 0 else self._plain(playout, now_ns)
            apart_m = position_m - plain_m
            position_m -= (1.0 - scales.trust) * apart_m
        position_m -= from_m
        move_m = position_m.copy() if is_kept else position_m
        position_m *= scales.velocity
        position_m += from_m
        covariance_m2 *= scales.noise
        if not is_kept:
            return None
        index, rest = divmod(now_ns * rate_hz, NS_PER_S)
        at = index, rest / NS_PER_S, octave
        return Forecast(*at, from_m, move_m, position_m, covariance_m2, plain_m, apart_m)

    def _rehearsed(
        self, filtered: InnovationsState, adaptation: Adaptation, playout: Playout, octave: int, now_ns: int
    ) -> list[Forecast]:
        """Return a forecast over a lag that no tick has now but an outage would: in turn of each longer octave."""
        n_longer = octave_of(_REHEARSED_NS, self.model.rate_hz) - octave
        if n_longer <= 0:
            return []
        chosen = octave + 1 + now_ns * (_CHECKS_PER_S + 1) // NS_PER_S % n_longer
        lag_ns = sample_instant_ns((3 << chosen) // 4, self.model.rate_hz)  # the octave's middle
        then_ns = sample_instant_ns(filtered.ring[-1].source_index, self.model.rate_hz) + lag_ns
        position_m, covariance_m2 = self._filter.step(filtered, playout, then_ns)[1]
        if position_m is None or covariance_m2 is None:
            return []
        found = self._issued(filtered, adaptation, playout, position_m, covariance_m2, then_ns, lag_ns, True)
        return [] if found is None else [found._replace(stands_for=n_longer)]

    def _plain(self, playout: Playout, now_ns: int) -> Array:
        """Return the forecast of `damped_velocity` for ``now_ns``, a sample of the arm having arrived."""
        arm = playout.arm
        age = playout.age_samples(arm.newest, now_ns)
        return continued(arm, self.model.forecast, age if age < self._horizon else self._horizon)
