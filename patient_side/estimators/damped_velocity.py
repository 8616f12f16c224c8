"""Damped velocity: the arm goes on as it went, ever slower; the command is not used."""

from dataclasses import dataclass

import numpy as np

from patient_side.estimators.protocol import Estimate
from patient_side.horizon import horizon_samples
from patient_side.input_path import continued
from patient_side.playout import Playout
from patient_side.statespace import ArmModel, Array


@dataclass(frozen=True)
class DampedVelocity:
    """Says nothing while no sample of the arm has arrived.

    Its covariance is the growth of the command's forecast through the gain D, as the arm of a static model
    moves like its command; between whole samples the growth is interpolated. For a model with states, or
    beyond the growth that is known, there is none.
    """

    model: ArmModel
    name: str = "damped_velocity"

    def initial(self) -> None:
        """Return the state: there is none."""

    def step(
        self,
        state: None,  # noqa: ARG002  the protocol's
        playout: Playout,
        now_ns: int,
    ) -> tuple[None, Estimate]:
        """Return the freshest position of the arm continued to ``now_ns``."""
        arm = playout.arm
        if arm.newest < 0:
            return None, Estimate(None)
        age = playout.age_samples(arm.newest, now_ns)
        age = min(max(age, 0.0), float(horizon_samples(playout.rate_hz)))
        return None, Estimate(continued(arm, self.model.forecast, age), self._covariance(age))

    def _covariance(self, age: float) -> Array | None:
        growth = self.model.forecast.growth_m
        if self.model.space.order or age > len(growth):
            return None
        knots = np.arange(len(growth) + 1)
        std = np.array([np.interp(age, knots, np.append(0.0, axis)) for axis in growth.T])
        return np.asarray(self.model.space.D @ np.diag(std**2) @ self.model.space.D.T)
