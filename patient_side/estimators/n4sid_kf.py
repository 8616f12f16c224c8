"""The Kalman filter of `moesp_kf` on the model that N4SID finds."""

from dataclasses import replace

import numpy as np

from common.errors import DataError, Fault
from patient_side.estimators.moesp_kf import MoespKf
from patient_side.statespace import ArmModel, FilterModel


def n4sid_kf(model: ArmModel) -> MoespKf:
    """Return the estimator; raises `DataError` where the model file holds no such model."""
    if model.n4sid is None:
        raise DataError(Fault("model", "n4sid", "n4sid_kf needs the model that n4sid finds, which this file has not"))
    return MoespKf(with_model(model, model.n4sid), name="n4sid_kf")


def with_model(model: ArmModel, own: FilterModel) -> ArmModel:
    """Return what is known of the arm with another model of its movement."""
    order = own.space.order
    return replace(
        model,
        order=order,
        space=own.space,
        x0=np.zeros(order),
        noise=own.noise,
        input_offset_m=own.input_offset_m,
        output_offset_m=own.output_offset_m,
        spectral_radius=own.space.spectral_radius(),
        static=own.static,
    )
