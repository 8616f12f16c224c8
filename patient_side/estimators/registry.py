"""Estimators by the names that scenarios use."""

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType
from typing import Final, get_args

from tis.common.scenario.estimator_names import EstimatorName, LearnedName, is_built_in
from tis.patient_side.estimators.adaptive_kf import AdaptiveKf
from tis.patient_side.estimators.damped_velocity import DampedVelocity
from tis.patient_side.estimators.direct_ls import direct_ls
from tis.patient_side.estimators.drmf import drmf
from tis.patient_side.estimators.guarded import Factories, build_own
from tis.patient_side.estimators.hold import Hold
from tis.patient_side.estimators.hold_last_arrived import HoldLastArrived
from tis.patient_side.estimators.innovations_kf import InnovationsKf
from tis.patient_side.estimators.learned_forecast import learned_forecast
from tis.patient_side.estimators.paper_as_printed import PaperAsPrinted
from tis.patient_side.estimators.protocol import Estimator
from tis.patient_side.estimators.static_gain import StaticGain
from tis.patient_side.estimators.velocity import Velocity
from tis.patient_side.statespace import ArmModel, with_model

# Filters that compute with filterpy are imported when one is built: it takes longer to load than all else.


def _moesp_kf(model: ArmModel) -> Estimator:
    from tis.patient_side.estimators.moesp_kf import MoespKf

    return MoespKf(model)


def _n4sid_kf(model: ArmModel) -> Estimator:
    from tis.patient_side.estimators.n4sid_kf import n4sid_kf

    return n4sid_kf(model)


def _arx_kf(model: ArmModel) -> Estimator:
    from tis.patient_side.estimators.arx_kf import arx_kf

    return arx_kf(model)


def _paper(model: ArmModel) -> Estimator:
    from tis.patient_side.estimators.paper import Paper

    return Paper(_paper_model(model))


def _paper_model(model: ArmModel) -> ArmModel:
    """Return the arm with the model of the paper's identification; unchanged where that is its own."""
    return model if model.paper is None else with_model(model, model.paper)


BUILDERS: Final[Mapping[EstimatorName, Callable[[ArmModel], Estimator]]] = MappingProxyType(
    {
        "hold": lambda _: Hold(),
        "hold_last_arrived": lambda _: HoldLastArrived(),
        "velocity": lambda _: Velocity(),
        "static_gain": StaticGain,
        "damped_velocity": DampedVelocity,
        "moesp_kf": _moesp_kf,
        "n4sid_kf": _n4sid_kf,
        "arx_kf": _arx_kf,
        "innovations_kf": InnovationsKf,
        "adaptive_kf": AdaptiveKf,
        "direct_ls": direct_ls,
        "drmf": drmf,
        "paper": _paper,
        "paper_as_printed": lambda model: PaperAsPrinted(_paper_model(model)),
        **{name: partial(learned_forecast, name) for name in get_args(LearnedName)},
    }
)


def build_estimator(name: EstimatorName, model: ArmModel) -> Estimator:
    """Return the built-in estimator called ``name`` for the arm that ``model`` describes; raises `DataError`."""
    return BUILDERS[name](model)


def build_any(name: str, model: ArmModel, own: Factories) -> Estimator:
    """Return the estimator called ``name``: a built-in one, or a user-defined one by ``own``, see `build_own`."""
    return build_estimator(name, model) if is_built_in(name) else build_own(name, own[name], model)
