"""The Kalman filter on the identified model: source time, freshest first, output predicted to now.

A tick has three parts. Up to the newest arm sample whose command is known, the filter advances permanently: arm
samples from before that which arrive later are ignored. From there to the newest sample of either stream it runs on
what has arrived, and the next tick repeats that part, as the missing commands may have arrived by then (the wait is
bounded, and so is the lag of the arm behind its commands). From there to now everything is forecast.

The estimate is the arm as it will have been recorded: between the two neighbouring sample instants the output
is interpolated linearly, which is the definition of truth, and measurement noise counts.

`n4sid_kf` is the same filter on the model that N4SID finds. `arx_kf` is it on the least-squares model with the last
outputs and commands as regressors, in innovations form, where validation chooses one lag or more. Where it chooses
none, the command determines the arm's present position but not its future one: then `arx_kf` is the filter of
`innovations_kf`, on the autoregression of the arm alone.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from tis.common.errors import DataError, Fault
from tis.common.units import NS_PER_S, sample_instant_ns
from tis.patient_side.estimators.innovations_kf import InnovationsKf
from tis.patient_side.estimators.protocol import Estimate
from tis.patient_side.filters import kalman
from tis.patient_side.filters.input_path import known_point, newest_velocity
from tis.patient_side.horizon import PATIENCE_SAMPLES, horizon_samples
from tis.patient_side.linear_system import Array
from tis.patient_side.playout import Playout
from tis.patient_side.statespace import ArmModel, with_model


@dataclass(frozen=True)
class FilterState:
    """Mean (d,) and covariance (d, d) at source index ``index``, given its arm sample ``output`` (3,) if any.

    The output is relative to the operating point. The arrays are read-only.
    """

    index: int
    mean: Array
    covariance: Array
    output: Array | None


def _frozen(index: int, belief: kalman.Belief, output: Array | None) -> FilterState:
    """Return the belief as a state: read-only copies of its arrays."""
    mean, covariance = belief.x.copy(), belief.P.copy()
    mean.flags.writeable = covariance.flags.writeable = False
    return FilterState(index, mean, covariance, output)


@dataclass(frozen=True)
class MoespKf:
    """No estimate before the first arrival; one of the two streams is enough.

    Without the arm's stream it simulates the model; without commands it treats them as unknown and infers
    them. More than 5 s after the freshest sample the estimate stays constant, and arm samples that arrive
    more than 5 s after fresher commands are ignored. A gap of more than 10 s restarts the filter.
    Oracles: a textbook filter in predictor form, and the consistency of errors and covariances.
    """

    model: ArmModel
    name: str = "moesp_kf"
    _augmented: kalman.AugmentedModel = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_augmented", kalman.augment(self.model, horizon_samples(self.model.rate_hz)))

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
        # Bounds the work after a long outage, when samples from before it carry little information.
        if state is None or newest - state.index > 2 * horizon:
            state = self._begin(playout, newest - horizon)
        until_ns = min(now_ns, sample_instant_ns(newest + horizon, playout.rate_hz))
        floor = ((until_ns + 1) * playout.rate_hz - 1) // NS_PER_S  # the last sample instant by then
        paired = arm.newest_before(command.newest + 1)
        settled = max(state.index, paired, arm.newest - PATIENCE_SAMPLES, newest - horizon)
        last = max(settled, min(newest, floor))
        belief = kalman.Belief(state.mean.copy(), state.covariance.copy())
        state, output = self._assimilate(belief, state, playout, settled, last)
        return state, self._estimate(belief, playout, last, max(floor, last), until_ns, output)

    def _begin(self, playout: Playout, earliest: int) -> FilterState:
        """Return the state one sample before the oldest that has arrived, at rest."""
        command, arm = playout.command, playout.arm
        first = min(i for i in (b.oldest_after(earliest - 1) for b in (command, arm)) if i >= 0)
        belief = kalman.initial_belief(self._augmented)
        if command.newest >= first:
            point = known_point(command, first)
            kalman.start_at(belief, self._augmented, point.position_m - self.model.input_offset_m, point.distance)
        return _frozen(first - 1, belief, None)

    def _assimilate(
        self, belief: kalman.Belief, state: FilterState, playout: Playout, settled: int, last: int
    ) -> tuple[FilterState, Array | None]:
        """Run ``belief`` from ``state`` to ``last``; return the state at ``settled`` and the output at ``last``."""
        augmented, command, output = self._augmented, playout.command, state.output
        if state.index == command.newest >= 0:
            # The command may have arrived since the last tick, as may an older one that changes its velocity.
            self._set_command(belief, playout, state.index)
        for index in range(state.index + 1, last + 1):
            kalman.predict(belief, augmented, output, ahead=index > command.newest)
            if index <= command.newest:
                self._set_command(belief, playout, index)
            measured = playout.arm.get(index)
            output = None if measured is None else measured - self.model.output_offset_m
            if output is not None:
                kalman.update(belief, augmented, output)
            if index == settled:
                belief.P = (belief.P + belief.P.T) / 2.0
                state = _frozen(index, belief, output)
        return state, output

    def _set_command(self, belief: kalman.Belief, playout: Playout, index: int) -> None:
        command, forecast = playout.command, self.model.forecast
        point = known_point(command, index)
        velocity = np.zeros(3)  # needed only where a forecast begins
        if index == command.newest:
            velocity = newest_velocity(command, forecast.velocity_span)
        relative = point.position_m - self.model.input_offset_m
        kalman.set_command(belief, self._augmented, relative, point.distance, velocity)

    def _estimate(
        self, belief: kalman.Belief, playout: Playout, last: int, floor: int, until_ns: int, output: Array | None
    ) -> Estimate:
        """Predict from index ``last`` to ``until_ns``, between ``floor`` and the next sample."""
        augmented = self._augmented
        # To the floor: a measured output enters the first step's transition, all further steps are taken at once.
        if output is not None and floor > last:
            kalman.predict(belief, augmented, output, ahead=True)
            last, output = last + 1, None
        if floor > last:
            kalman.predict_ahead(belief, augmented, floor - last)
        begin_ns = sample_instant_ns(floor, playout.rate_hz)
        end_ns = sample_instant_ns(floor + 1, playout.rate_hz)
        f = min(max((until_ns - begin_ns) / (end_ns - begin_ns), 0.0), 1.0)

        # Between the floor and the next sample: interpolation of two correlated outputs.
        H, R, S = augmented.H, augmented.R, augmented.S
        here, here_P = belief.x, belief.P
        kalman.predict(belief, augmented, output, ahead=True)
        there = H @ belief.x
        there_P = H @ belief.P @ H.T + R
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


def n4sid_kf(model: ArmModel) -> MoespKf:
    """Return the estimator; raises `DataError` where the model file holds no such model."""
    if model.n4sid is None:
        raise DataError(Fault("model", "n4sid", "n4sid_kf needs the model that n4sid finds; the file holds none"))
    return MoespKf(with_model(model, model.n4sid), name="n4sid_kf")


def arx_kf(model: ArmModel) -> MoespKf | InnovationsKf:
    """Return the estimator; raises `DataError` where the model file holds no such model."""
    if model.arx is None:
        raise DataError(Fault("model", "arx", "arx_kf needs the model that arx finds; the file holds none"))
    own = with_model(model, model.arx)
    if model.autoregression is None:
        return MoespKf(own, name="arx_kf")
    return InnovationsKf(replace(own, innovations=model.autoregression, commanded=None), name="arx_kf")
