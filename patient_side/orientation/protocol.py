"""The interface of an orientation method: a pure function of the arrived samples and an instant."""

from typing import NamedTuple, Protocol

from tis.common.scenario.patient import OrientationMethod
from tis.patient_side.playout import SourceBuffer
from tis.patient_side.statespace import Array


class WristEstimate(NamedTuple):
    """Orientation and gripper of the arm at an instant; None where there is no estimate, or no covariance.

    ``orientation`` (4,) is a unit quaternion x, y, z, w. ``covariance_rad2`` (3, 3) is that of the rotation vector
    from the estimate to the truth, in the body frame of the estimate; ``gripper_variance_rad2`` that of the gripper.
    """

    orientation: Array | None
    covariance_rad2: Array | None = None
    gripper_rad: float | None = None
    gripper_variance_rad2: float | None = None


NOTHING = WristEstimate(None)


class WristMethod(Protocol):
    """A method without a state: it reads the arm's arrived samples only, which makes it causal."""

    @property
    def name(self) -> OrientationMethod:
        """Return the name that scenarios use."""
        ...

    def estimate(self, arm: SourceBuffer, age_samples: float) -> WristEstimate:
        """Return the estimate ``age_samples`` >= 0 sample periods, fractions included, after the newest sample."""
        ...
