"""Velocity: the arm continues at the velocity of its last two samples until a newer one arrives."""

from dataclasses import dataclass

from tis.patient_side.estimators.protocol import Estimate
from tis.patient_side.filters.input_path import newest_velocity
from tis.patient_side.horizon import horizon_samples
from tis.patient_side.playout import Playout


@dataclass(frozen=True)
class Velocity:
    """No estimate while no sample of the arm has arrived; constant after 5 s; no covariance.

    Where the sample before the freshest has not arrived, the nearest one replaces it, at its true distance.
    """

    name: str = "velocity"

    def initial(self) -> None:
        """Return the state: there is none."""

    def step(self, state: None, playout: Playout, now_ns: int) -> tuple[None, Estimate]:  # noqa: ARG002  protocol
        """Return the freshest position of the arm extrapolated to ``now_ns`` at the last velocity."""
        arm = playout.arm
        newest = arm.get(arm.newest)
        if newest is None:
            return None, Estimate(None)
        age = min(max(playout.age_samples(arm.newest, now_ns), 0.0), float(horizon_samples(playout.rate_hz)))
        return None, Estimate(newest + newest_velocity(arm, 1) * age)
