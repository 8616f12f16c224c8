"""`innovations_kf` that adapts while it runs: scales of velocity and noise, tracked on its own errors.

What the hand's model leaves to the hand is in `tis.patient_side.filters.adaptation`. The estimator is off unless a
scenario names it.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

from tis.common.units import NS_PER_S
from tis.patient_side.estimators.innovations_kf import InnovationsKf, InnovationsState
from tis.patient_side.estimators.protocol import Estimate
from tis.patient_side.filters.adaptation import Adaptation, Adapter, Forecast, octave_of
from tis.patient_side.filters.innovations_filter import AXES
from tis.patient_side.horizon import horizon_samples
from tis.patient_side.playout import Playout
from tis.patient_side.statespace import ArmModel


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
