"""Constant rate: the arm turns on about the axis of its last turn, and slows down; the gripper likewise."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from tis.patient_side.filters.input_path import damped_steps
from tis.patient_side.movement_models import RateModel
from tis.patient_side.orientation.protocol import NOTHING, WristEstimate
from tis.patient_side.playout import SourceBuffer
from tis.patient_side.rotations import at_end, turned, turned_by
from tis.patient_side.statespace import Array


@dataclass(frozen=True)
class ConstantRate:
    """No estimate while no sample of the arm has arrived; no movement while only one has.

    A rate that is not damped loses to hold beyond 200 ms, as hands stop and turn back. The covariance is that of the
    training rows; beyond the last horizon the forecast stays constant, and it grows like that of a random walk.
    Oracle: an arm that turns at a constant speed about a known axis.
    """

    orientation: RateModel
    gripper: RateModel
    name: Literal["constant_rate"] = "constant_rate"

    def estimate(self, arm: SourceBuffer, age_samples: float) -> WristEstimate:
        """Return the newest orientation and gripper, moved on at their damped rates."""
        newest = arm.orientation(arm.newest)
        if newest is None:
            return NOTHING
        moved, covariance = np.zeros(3), _covariance(self.orientation, age_samples)
        other = _earlier(arm, self.orientation)
        earlier = arm.orientation(other)
        if earlier is not None:
            steps = _steps(self.orientation, age_samples) * self.orientation.stride / (arm.newest - other)
            moved = -steps * turned(newest, earlier)
        gripper_rad = arm.gripper_rad(arm.newest)
        if gripper_rad is not None:
            other = _earlier(arm, self.gripper)
            earlier_rad = arm.gripper_rad(other) if other >= 0 else None
            if earlier_rad is not None:
                steps = _steps(self.gripper, age_samples) * self.gripper.stride / (arm.newest - other)
                gripper_rad += steps * (gripper_rad - earlier_rad)
        return WristEstimate(
            turned_by(newest, moved),
            at_end(moved, covariance),
            gripper_rad,
            float(_covariance(self.gripper, age_samples)[0, 0]),
        )


def _earlier(arm: SourceBuffer, model: RateModel) -> int:
    """Return the arrived sample that the rate is measured from: nearest to the model's span ago, or -1."""
    wanted = arm.newest - model.velocity_span * model.stride
    older, younger = arm.newest_before(wanted + 1), arm.oldest_after(wanted)
    return (
        older
        if older >= 0 and (younger == arm.newest or wanted - older <= younger - wanted)
        else (younger if younger != arm.newest else -1)
    )


def _steps(model: RateModel, age_samples: float) -> float:
    """Return the distance that the forecast covers, in steps of the rate."""
    return damped_steps(model.damping, min(age_samples / model.stride, float(model.horizons[-1])))


def _covariance(model: RateModel, age_samples: float) -> Array:
    """Return the error's covariance (d, d): interpolated between horizons, from 0 at age 0."""
    steps, horizons = age_samples / model.stride, model.horizons
    at = int(np.searchsorted(horizons, steps))
    if at == len(horizons):
        return np.asarray(model.covariance[-1] * (steps / horizons[-1]))
    if at == 0:
        return np.asarray(model.covariance[0] * (steps / horizons[0]) ** 2)
    share = (steps - horizons[at - 1]) / (horizons[at] - horizons[at - 1])
    return np.asarray((1.0 - share) * model.covariance[at - 1] + share * model.covariance[at])
