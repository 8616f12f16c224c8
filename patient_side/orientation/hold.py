"""Hold: orientation and gripper stay those of the freshest sample by source stamp. The reference of all scores."""

from dataclasses import dataclass
from typing import Literal

from tis.patient_side.orientation.protocol import WristEstimate
from tis.patient_side.playout import SourceBuffer


@dataclass(frozen=True)
class Hold:
    """No estimate while no sample of the arm has arrived, and no covariance."""

    name: Literal["hold"] = "hold"

    def estimate(self, arm: SourceBuffer, age_samples: float) -> WristEstimate:  # noqa: ARG002  protocol
        """Return the freshest orientation and gripper angle."""
        return WristEstimate(arm.orientation(arm.newest), None, arm.gripper_rad(arm.newest))
