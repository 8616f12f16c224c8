"""The linear forecast of the arm's own movement, corrected by a learned method.

The Kalman filter of `innovations_kf`, without its correction, forecasts the arm; the learned method reads the recent
path that has arrived, and the forecast's age, and adds the mean of what the linear forecast leaves. Where nothing is
known it adds little: its training rows have the same losses and delays as a bad network's.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import exp, sqrt
from typing import Any

import numpy as np

from tis.common.errors import DataError, Fault
from tis.patient_side.estimators.innovations_kf import InnovationsKf, InnovationsState
from tis.patient_side.estimators.protocol import Estimate
from tis.patient_side.filters.innovations_filter import AXES
from tis.patient_side.filters.stand_in import StandIn
from tis.patient_side.learned.inputs import activity_of, stride_of, window_before
from tis.patient_side.learned.predictor import MAX_AGE, Predictor, predictor_of
from tis.patient_side.learned_model import LearnedModel
from tis.patient_side.linear_system import Array
from tis.patient_side.playout import Playout
from tis.patient_side.statespace import ArmModel


def linear_forecast(model: ArmModel) -> InnovationsKf:
    """Return the filter whose forecasts are corrected; raises `DataError` where the model file holds none."""
    if model.innovations is None:
        rule = "learned methods need the innovations form of the arm's movement; the file holds none"
        raise DataError(Fault("model", "innovations", rule))
    return InnovationsKf(replace(model, innovations=replace(model.innovations, correction=None), commanded=None))


def learned_forecast(name: str, model: ArmModel) -> "LearnedForecast":
    """Return the estimator called ``name``; raises `DataError` where the model file holds no such model."""
    for learned in model.learned:
        if learned.method == name:
            return LearnedForecast(model, learned, name)
    rule = f"the model holds none for {name}: train one with `tis identify --set identification.method={name}`"
    raise DataError(Fault("model", "learned", rule, ", ".join(each.method for each in model.learned) or "none"))


@dataclass(frozen=True)
class LearnedForecast:
    """No estimate before the first arrival.

    Where a gain alone relates the arm to its command, a command stands in for a sample that has not arrived, as in
    `InnovationsKf`. Beyond an age of 5 s what is added stays constant. Oracles: the training rows' own arithmetic
    (test_learned_forecast), and causality (test_causality).
    """

    model: ArmModel
    learned: LearnedModel
    name: str
    _linear: InnovationsKf = field(init=False, repr=False)
    _stand_in: StandIn | None = field(init=False, repr=False)
    _predictor: Predictor = field(init=False, repr=False)
    _stride: int = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_linear", linear_forecast(self.model))
        object.__setattr__(self, "_stand_in", StandIn.of(self.model))
        object.__setattr__(self, "_predictor", predictor_of(self.learned))
        object.__setattr__(self, "_stride", stride_of(self.model.rate_hz))

    def initial(self) -> InnovationsState:
        """Return the state before the first arrival: the linear filter's."""
        return self._linear.initial()

    def step(self, state: Any, playout: Playout, now_ns: int) -> tuple[InnovationsState, Estimate]:
        """Return the state after what has arrived, and the estimate for ``now_ns``."""
        state, linear = self._linear.step(state, playout, now_ns)
        if linear.position_m is None or linear.covariance_m2 is None:
            return state, linear
        newest = state.ring[-1]
        age = playout.age_samples(newest.source_index, now_ns) / self._stride
        if age <= 0.0:
            return state, linear
        # The path up to the newest sample, in units of the hand's activity.
        sample = self._samples(state, playout)
        window = window_before(newest.source_index, self._stride, sample, playout.arm.gripper_rad)
        activity = activity_of(window, self.learned.usual_m)
        # What is left, in units of the linear forecast's deviation at that activity.
        scale = float(activity[0]) / sqrt(newest.activity[0])
        unit_m = scale * sqrt(np.trace(linear.covariance_m2) / AXES)
        here_m = sample(newest.source_index)
        assert here_m is not None, "the filter's newest sample is known"
        found = self._predictor(window, activity, min(age, MAX_AGE), (linear.position_m - here_m) / unit_m)
        factor = (scale * exp(found.log_deviation)) ** 2 * found.covariance_scale
        return state, Estimate(linear.position_m + unit_m * found.mean, factor * linear.covariance_m2)

    def _samples(self, state: InnovationsState, playout: Playout) -> Callable[[int], Array | None]:
        """Return the arm's sample by source index, or what a command tells of it."""
        of_arm, of_command, stand_in = playout.arm.get, playout.command.get, self._stand_in
        if stand_in is None or not (state.pairs or playout.arm.newest < 0):
            return of_arm
        offset_m = (state.offset or stand_in.offset(state.pairs, playout)).offset_m
        gain = stand_in.gain

        def sample(index: int) -> Array | None:
            found = of_arm(index)
            if found is None:
                command = of_command(index)
                return None if command is None else gain.dot(command) + offset_m
            return found

        return sample
