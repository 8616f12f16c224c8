"""An alpha-beta filter by source time, forecast to now by the age of its newest sample."""

from typing import NamedTuple

import numpy as np

from tis.patient_side.estimators.protocol import Estimate

ALPHA, BETA, KEPT = 0.8, 0.5, 0.95


class Track(NamedTuple):
    """The state between two ticks."""

    index: int  # the newest sample that was used
    position_m: np.ndarray
    step_m: np.ndarray  # velocity: metres in one sample period
    error_m2: np.ndarray  # mean square of what a forecast over one sample was off by, per axis


class AlphaBeta:
    """Position and velocity, corrected by each sample that arrives in order of source time."""

    def __init__(self, model):
        self.usual_m2 = model.forecast.growth_m[0] ** 2  # from the training rows, until there is experience

    def initial(self):
        """Return the state before the first arrival."""
        return None

    def step(self, state, playout, now_ns):
        """Return the new state and the position at `now_ns`."""
        arm = playout.arm
        if arm.newest < 0:  # nothing has arrived yet
            return state, Estimate(None)
        if state is None:
            state = Track(arm.newest, arm.get(arm.newest), np.zeros(3), self.usual_m2)
        for index in arm.after(state.index):  # in order of source time; what comes later than that is left out
            gap = index - state.index  # 2 and more where samples are missing
            foreseen_m = state.position_m + gap * state.step_m
            off_m = arm.get(index) - foreseen_m
            error_m2 = KEPT * state.error_m2 + (1 - KEPT) * (off_m / gap**1.5) ** 2
            state = Track(index, foreseen_m + ALPHA * off_m, state.step_m + BETA / gap * off_m, error_m2)
        age = playout.age_samples(state.index, now_ns)  # in sample periods, with fractions
        position_m = state.position_m + age * state.step_m
        return state, Estimate(position_m, np.diag(state.error_m2 * max(age, 1.0) ** 3))
