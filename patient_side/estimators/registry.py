"""Estimators by the names that scenarios use."""

from typing import assert_never

from common.scenario.estimator_names import EstimatorName, is_built_in
from patient_side.estimators.arx_kf import arx_kf
from patient_side.estimators.damped_velocity import DampedVelocity
from patient_side.estimators.direct_ls import direct_ls
from patient_side.estimators.guarded import Factories, build_own
from patient_side.estimators.hold import Hold
from patient_side.estimators.hold_last_arrived import HoldLastArrived
from patient_side.estimators.innovations_kf import InnovationsKf
from patient_side.estimators.moesp_kf import MoespKf
from patient_side.estimators.n4sid_kf import n4sid_kf
from patient_side.estimators.paper import Paper
from patient_side.estimators.paper_as_printed import PaperAsPrinted
from patient_side.estimators.protocol import Estimator
from patient_side.estimators.static_gain import StaticGain
from patient_side.estimators.velocity import Velocity
from patient_side.statespace import ArmModel, with_model


def build_any(name: str, model: ArmModel, own: Factories) -> Estimator:
    """Return the estimator called ``name``, the testbed's, or a user's by ``own``; raises as `build_own` does."""
    return build_estimator(name, model) if is_built_in(name) else build_own(name, own[name], model)


def build_estimator(name: EstimatorName, model: ArmModel) -> Estimator:
    """Return the estimator called ``name`` for the arm that ``model`` describes."""
    match name:
        case "hold":
            return Hold()
        case "hold_last_arrived":
            return HoldLastArrived()
        case "velocity":
            return Velocity()
        case "static_gain":
            return StaticGain(model)
        case "damped_velocity":
            return DampedVelocity(model)
        case "moesp_kf":
            return MoespKf(model)
        case "n4sid_kf":
            return n4sid_kf(model)
        case "arx_kf":
            return arx_kf(model)
        case "innovations_kf":
            return InnovationsKf(model)
        case "direct_ls":
            return direct_ls(model)
        case "paper":
            return Paper(_as_the_paper(model))
        case "paper_as_printed":
            return PaperAsPrinted(_as_the_paper(model))
    assert_never(name)


def _as_the_paper(model: ArmModel) -> ArmModel:
    """Return the arm with the model that the paper's identification finds; it is the arm's own where that was it."""
    return model if model.paper is None else with_model(model, model.paper)
