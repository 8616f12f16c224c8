"""The Kalman filter of `moesp_kf` on the model that N4SID finds."""

from tis.common.errors import DataError, Fault
from tis.patient_side.estimators.moesp_kf import MoespKf
from tis.patient_side.statespace import ArmModel, with_model


def n4sid_kf(model: ArmModel) -> MoespKf:
    """Return the estimator; raises `DataError` where the model file holds no such model."""
    if model.n4sid is None:
        raise DataError(Fault("model", "n4sid", "n4sid_kf needs the model that n4sid finds; the file holds none"))
    return MoespKf(with_model(model, model.n4sid), name="n4sid_kf")
