"""Direct least squares: one regression for each horizon on the arm's past positions that have arrived."""

from dataclasses import dataclass, field

from tis.common.errors import DataError, Fault
from tis.patient_side.estimators.direct_forecast import DirectForecast, arrived_past
from tis.patient_side.estimators.protocol import Estimate
from tis.patient_side.identification.direct_ls import differences
from tis.patient_side.movement_models import DirectModel
from tis.patient_side.playout import Playout
from tis.patient_side.statespace import ArmModel


def direct_ls(model: ArmModel) -> "DirectLs":
    """Return the estimator; raises `DataError` where the model file holds no such model."""
    if model.direct is None:
        raise DataError(
            Fault("model", "direct", "direct_ls needs moments of the arm's movement; the file holds none")
        )
    return DirectLs(model.direct)


@dataclass(frozen=True)
class DirectLs:
    """No estimate while no sample of the arm has arrived; forecasts and missing samples: see `DirectForecast`."""

    model: DirectModel
    name: str = "direct_ls"
    _forecast: DirectForecast = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_forecast", DirectForecast(self.model))

    def initial(self) -> None:
        """Return the state: there is none."""

    def step(self, state: None, playout: Playout, now_ns: int) -> tuple[None, Estimate]:  # noqa: ARG002  protocol
        """Return the forecast from the freshest sample of the arm to ``now_ns``, and its covariance."""
        arm, direct = playout.arm, self.model
        newest = arm.get(arm.newest)
        if newest is None:
            return None, Estimate(None)
        steps = max(playout.age_samples(arm.newest, now_ns) / direct.stride, 0.0)
        past = arrived_past(arm, direct.lags, direct.stride, arm.get)
        moved, covariance = self._forecast.ahead(steps, past.moves(newest, arm.get, differences), past.known)
        return None, Estimate(newest + moved, covariance)
