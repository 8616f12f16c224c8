"""The Kalman filter on the identified model: source time, freshest first, output predicted to now.

A tick has three parts. Up to the newest arm sample whose command is known, the filter advances for good: arm
samples from before that which come later are left out. From there to the newest sample of either stream it
runs on what has arrived, but that part is done again at the next tick, when the missing commands may be there
(their patience has an end, as has the time that the arm may lag behind its commands). From there to now
everything is forecast.

The answer is the arm as it will have been recorded: between the two neighbouring sample instants the output
is interpolated linearly, which is what truth is defined to be, and measurement noise counts.
"""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from common.units import NS_PER_S, sample_instant_ns
from patient_side.estimators.protocol import Estimate
from patient_side.filters.input_path import known_point, newest_velocity
from patient_side.filters.kalman import (
    AugmentedModel,
    augment,
    build_filter,
    predict,
    predict_ahead,
    set_command,
    start_at,
)
from patient_side.horizon import PATIENCE_SAMPLES, horizon_samples
from patient_side.playout import Playout
from patient_side.statespace import ArmModel, Array

if TYPE_CHECKING:
    from filterpy.kalman import KalmanFilter


@dataclass(frozen=True)
class FilterState:
    """Mean (d,) and covariance (d, d) at source index ``index``, given its arm sample ``output`` (3,) if any.

    The output is relative to the operating point. The arrays are read-only.
    """

    index: int
    mean: Array
    covariance: Array
    output: Array | None


def _frozen(index: int, kf: "KalmanFilter", output: Array | None) -> FilterState:
    """Return the filter's state in arrays of its own that nobody can write to."""
    mean, covariance = kf.x.copy(), kf.P.copy()
    mean.flags.writeable = covariance.flags.writeable = False
    return FilterState(index, mean, covariance, output)


@dataclass(frozen=True)
class MoespKf:
    """Says nothing while nothing has arrived, and needs only one of the two streams.

    Without the arm's stream it simulates the model; without commands it takes them as unknown and infers
    them. More than 5 s after the freshest sample the estimate stays where it is, and arm samples that come
    more than 5 s after fresher commands are left out. A gap of more than 10 s starts the filter anew.
    Oracles: a textbook filter in predictor form, and the consistency of errors and covariances.
    """

    model: ArmModel
    name: str = "moesp_kf"
    _augmented: AugmentedModel = field(init=False, repr=False)
    _kf: "KalmanFilter" = field(init=False, repr=False)

    def __post_init__(self) -> None:
        augmented = augment(self.model, horizon_samples(self.model.rate_hz))
        object.__setattr__(self, "_augmented", augmented)
        # Scratch space: every step loads its state first, so nothing of one step reaches the next.
        object.__setattr__(self, "_kf", build_filter(augmented))

    def initial(self) -> FilterState | None:
        """Return the state before the first arrival: none."""
        return None

    def step(self, state: FilterState | None, playout: Playout, now_ns: int) -> tuple[FilterState | None, Estimate]:
        """Return the state after what has arrived, and the estimate for ``now_ns``."""
        command, arm = playout.command, playout.arm
        newest = max(command.newest, arm.newest)
        if newest < 0:
            return state, Estimate(None)
        horizon = self._augmented.horizon
        # Bounds the work after a long outage, when what was before it tells little.
        if state is None or newest - state.index > 2 * horizon:
            state = self._begin(playout, newest - horizon)
        until_ns = min(now_ns, sample_instant_ns(newest + horizon, playout.rate_hz))
        floor = ((until_ns + 1) * playout.rate_hz - 1) // NS_PER_S  # the last sample instant by then
        paired = arm.newest_before(command.newest + 1)
        settled = max(state.index, paired, arm.newest - PATIENCE_SAMPLES, newest - horizon)
        last = max(settled, min(newest, floor))
        state, output = self._assimilate(state, playout, settled, last)
        return state, self._estimate(playout, last, max(floor, last), until_ns, output)

    def _begin(self, playout: Playout, earliest: int) -> FilterState:
        """Return the state one sample before the oldest that has arrived, at rest."""
        command, arm = playout.command, playout.arm
        first = min(i for i in (b.oldest_after(earliest - 1) for b in (command, arm)) if i >= 0)
        kf = build_filter(self._augmented)
        if command.newest >= first:
            point = known_point(command, first)
            start_at(kf, self._augmented, point.position_m - self.model.input_offset_m, point.distance)
        return _frozen(first - 1, kf, None)

    def _assimilate(
        self, state: FilterState, playout: Playout, settled: int, last: int
    ) -> tuple[FilterState, Array | None]:
        """Run to index ``last``; return the state at ``settled``, and the output at ``last`` if any."""
        kf, augmented, command = self._kf, self._augmented, playout.command
        kf.x, kf.P, output = state.mean.copy(), state.covariance.copy(), state.output
        if state.index == command.newest >= 0:
            # It may have come since, as may an older one that changes its velocity.
            self._set_command(playout, state.index)
        for index in range(state.index + 1, last + 1):
            predict(kf, augmented, output, ahead=index > command.newest)
            if index <= command.newest:
                self._set_command(playout, index)
            measured = playout.arm.get(index)
            output = None if measured is None else measured - self.model.output_offset_m
            if output is not None:
                kf.update(output)
            if index == settled:
                kf.P = (kf.P + kf.P.T) / 2.0
                state = _frozen(index, kf, output)
        return state, output

    def _set_command(self, playout: Playout, index: int) -> None:
        command, forecast = playout.command, self.model.forecast
        point = known_point(command, index)
        velocity = np.zeros(3)  # needed only where a forecast begins
        if index == command.newest:
            velocity = newest_velocity(command, forecast.velocity_span)
        relative = point.position_m - self.model.input_offset_m
        set_command(self._kf, self._augmented, relative, point.distance, velocity)

    def _estimate(self, playout: Playout, last: int, floor: int, until_ns: int, output: Array | None) -> Estimate:
        """Predict from index ``last`` to ``until_ns``, between ``floor`` and the next sample."""
        kf, augmented = self._kf, self._augmented
        if output is not None and floor > last:
            predict(kf, augmented, output, ahead=True)
            last, output = last + 1, None
        if floor > last:
            predict_ahead(kf, augmented, floor - last)
        begin_ns = sample_instant_ns(floor, playout.rate_hz)
        end_ns = sample_instant_ns(floor + 1, playout.rate_hz)
        f = min(max((until_ns - begin_ns) / (end_ns - begin_ns), 0.0), 1.0)

        H, R, S = augmented.H, augmented.R, augmented.S
        here, here_P = kf.x, kf.P
        predict(kf, augmented, output, ahead=True)
        there = H @ kf.x
        there_P = H @ kf.P @ H.T + R
        if output is not None:
            # The sample at the floor is known as it will be recorded; only the next one is not.
            mean, covariance = (1.0 - f) * output + f * there, f**2 * there_P
        else:
            mean = (1.0 - f) * (H @ here) + f * there
            across = H @ here_P @ augmented.F.T @ H.T + S.T @ H.T
            covariance = (
                (1.0 - f) ** 2 * (H @ here_P @ H.T + R) + f**2 * there_P + f * (1.0 - f) * (across + across.T)
            )
        return Estimate(mean + self.model.output_offset_m, (covariance + covariance.T) / 2.0)
