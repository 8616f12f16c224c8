"""Least squares in the tangent space: `direct_ls` for orientation and gripper.

At the newest orientation R the past is ``log(R^-1 R_past)`` and the future ``log(R^-1 R_future)``, rotation vectors
in the body frame of R. One regression for each horizon forecasts d, and the estimate is ``R exp(d)``.
"""

from dataclasses import dataclass, field
from typing import Literal

from tis.patient_side.estimators.direct_ls import DirectForecast, arrived_past
from tis.patient_side.identification.direct_ls import differences
from tis.patient_side.movement_models import DirectModel
from tis.patient_side.orientation.protocol import NOTHING, WristEstimate
from tis.patient_side.playout import SourceBuffer
from tis.patient_side.rotations import at_end, turned, turned_by


@dataclass(frozen=True)
class TangentLs:
    """No estimate while no sample of the arm has arrived.

    Samples that have not arrived are replaced as `DirectForecast` does. Oracles: numpy's least squares row by row, an
    arm that turns at a constant speed, and coverage on synthetic movements.
    """

    orientation: DirectModel
    gripper: DirectModel
    name: Literal["tangent_ls"] = "tangent_ls"
    _orientation: DirectForecast = field(init=False, repr=False)
    _gripper: DirectForecast = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_orientation", DirectForecast(self.orientation))
        object.__setattr__(self, "_gripper", DirectForecast(self.gripper))

    def estimate(self, arm: SourceBuffer, age_samples: float) -> WristEstimate:
        """Return the forecast from the newest sample, and its covariances."""
        newest = arm.orientation(arm.newest)
        if newest is None:
            return NOTHING
        lags, stride = self.orientation.lags, self.orientation.stride
        past = arrived_past(arm, lags, stride, arm.orientation)
        steps = age_samples / stride
        moved, covariance = self._orientation.ahead(steps, past.moves(newest, arm.orientation, turned), past.known)
        at, turned_covariance = turned_by(newest, moved), at_end(moved, covariance)
        # The same samples, so the same past: both models have the same lags.
        now = arm.gripper_angle(arm.newest)
        if now is None:
            return WristEstimate(at, turned_covariance)
        opened, variance = self._gripper.ahead(steps, past.moves(now, arm.gripper_angle, differences), past.known)
        return WristEstimate(at, turned_covariance, float(now[0] + opened[0]), float(variance[0, 0]))
