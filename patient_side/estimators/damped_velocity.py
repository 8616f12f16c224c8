"""Damped velocity: the arm continues at its last velocity, slows down and returns; the command is not used."""

from dataclasses import dataclass, field

import numpy as np

from tis.patient_side.estimators.protocol import Estimate
from tis.patient_side.filters.input_path import continued
from tis.patient_side.horizon import horizon_samples
from tis.patient_side.playout import Playout
from tis.patient_side.statespace import ArmModel, Array


@dataclass(frozen=True)
class DampedVelocity:
    """No estimate while no sample of the arm has arrived.

    Its covariance is the error growth of the command's forecast through the gain D, as the arm of a static model
    moves like its command; between whole samples the growth is interpolated. There is none for a model with states,
    and none beyond the horizon of the known growth.
    """

    model: ArmModel
    name: str = "damped_velocity"
    _std_m: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        # Deviation of the command's forecast 0 .. H samples ahead; H is repeated as the interpolation's right end.
        growth_m, std_m = self.model.forecast.growth_m, np.empty((0, 3))
        if self.model.space.order == 0:
            std_m = np.vstack([np.zeros((1, 3)), growth_m, growth_m[-1:]])
        object.__setattr__(self, "_std_m", std_m)

    def initial(self) -> None:
        """Return the state: there is none."""

    def step(self, state: None, playout: Playout, now_ns: int) -> tuple[None, Estimate]:  # noqa: ARG002  protocol
        """Return the forecast from the freshest position of the arm to ``now_ns``."""
        arm = playout.arm
        if arm.newest < 0:
            return None, Estimate(None)
        age = playout.age_samples(arm.newest, now_ns)
        age = min(max(age, 0.0), float(horizon_samples(playout.rate_hz)))
        return None, Estimate(continued(arm, self.model.forecast, age), self._covariance(age))

    def _covariance(self, age: float) -> Array | None:
        if age > len(self.model.forecast.growth_m) or not len(self._std_m):
            return None
        after = int(age)
        fraction = age - after
        std_m = (1.0 - fraction) * self._std_m[after] + fraction * self._std_m[after + 1]
        gain = self.model.space.D
        return np.asarray((gain * std_m**2).dot(gain.T))
