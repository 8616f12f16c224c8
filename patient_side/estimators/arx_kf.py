"""The Kalman filter on the least-squares model with the last outputs and commands as regressors.

Where validation chooses one lag or more, it is the filter of `moesp_kf` on that model in innovations form. Where it
chooses none, the command determines the arm's present position but not its future one: then it is the filter of
`innovations_kf`, on the autoregression of the arm alone.
"""

from dataclasses import replace

from tis.common.errors import DataError, Fault
from tis.patient_side.estimators.innovations_kf import InnovationsKf
from tis.patient_side.estimators.moesp_kf import MoespKf
from tis.patient_side.statespace import ArmModel, with_model


def arx_kf(model: ArmModel) -> MoespKf | InnovationsKf:
    """Return the estimator; raises `DataError` where the model file holds no such model."""
    if model.arx is None:
        raise DataError(Fault("model", "arx", "arx_kf needs the model that arx finds; the file holds none"))
    own = with_model(model, model.arx)
    if model.autoregression is None:
        return MoespKf(own, name="arx_kf")
    return InnovationsKf(replace(own, innovations=model.autoregression), name="arx_kf")
