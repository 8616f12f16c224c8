"""The models of an arm's wrist: its orientation and the angle of its gripper."""

from dataclasses import dataclass

from tis.common.scenario.patient import OrientationMethod
from tis.patient_side.direct_model import Array, DirectModel


@dataclass(frozen=True)
class RateModel:
    """Forecast by a damped rate: h steps ahead the signal has moved by ``v sum_k phi^k``, k = 1..h.

    phi is ``damping``; the rate v is the mean over the last ``velocity_span`` steps, and a step is ``stride``
    samples. ``covariance`` (H, d, d) is that of the forecast's error over ``horizons`` (H,) steps, in rad^2, so that
    95 % ellipsoids hold 95 % of new errors.
    """

    stride: int
    damping: float
    velocity_span: int
    horizons: Array
    covariance: Array


@dataclass(frozen=True)
class WristModel:
    """Models of orientation and gripper; None where they were not requested or the rows do not allow them.

    ``rate`` and ``direct`` are of the orientation in the tangent space at the newest sample, in its body frame, three
    axes in rad; ``gripper_rate`` and ``gripper_direct`` of the gripper's angle, one axis in rad.
    """

    rate: RateModel | None = None
    gripper_rate: RateModel | None = None
    direct: DirectModel | None = None
    gripper_direct: DirectModel | None = None

    def serves(self, method: OrientationMethod) -> bool:
        """Tell whether the models that an orientation method needs are there."""
        needed = {
            "hold": (),
            "constant_rate": (self.rate, self.gripper_rate),
            "tangent_ls": (self.direct, self.gripper_direct),
        }
        return None not in needed[method]
