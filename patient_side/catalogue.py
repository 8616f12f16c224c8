"""The estimators, one row each: builder, model and look. Whoever lists estimators reads them here.

A new estimator is its own module, its name in `tis.common.scenario.estimator_names`, and its row. Rows name their
code by its place in `tis.patient_side.estimators`, which is imported when an estimator is built: filters on filterpy
take longer to load than all else, and a report needs only the looks.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, Literal

from tis.common.scenario.estimator_names import EstimatorName, LearnedName

if TYPE_CHECKING:
    from tis.patient_side.estimators.protocol import Estimator
    from tis.patient_side.statespace import ArmModel

Hue = Literal["VERMILION", "GREEN", "PINK", "VIOLET", "BROWN", "BLUE", "AMBER"]
"""Names of tones in `tis.deploy.present.palette`."""
Dash = Literal["solid", "dashed", "dotted", "dashdot"]


@dataclass(frozen=True)
class EstimatorRow:
    """An estimator: how it is built from an arm's models, the style of its lines, and what it shares.

    Attributes
    ----------
    build
        Returns the estimator for an arm; raises `DataError` where the arm lacks its model.
    hue, dash
        The style of its lines in all figures; no two estimators look alike.
    fit
        Place of the function in `tis.patient_side` that fits its models to `companions.TrainingRows`; "" without any.
    slow
        Whether the fit takes several seconds, and is not tried for user-defined estimators.
    fitted_with
        The estimator whose model it uses, where it has none of its own.
    benched
        Whether `tis bench` measures its steps.
    """

    build: "Callable[[ArmModel], Estimator]"
    hue: Hue
    dash: Dash = "solid"
    fit: str = ""
    slow: bool = False
    fitted_with: EstimatorName | None = None
    benched: bool = False


def code_at(place: str) -> Any:
    """Return what lies at ``module:name`` in `tis.patient_side`."""
    module, name = place.split(":")
    return getattr(import_module(f"tis.patient_side.{module}"), name)


def _plain(place: str) -> "Callable[[ArmModel], Estimator]":
    """Return the builder of an estimator without a model, by the place of its code: ``module:name``."""
    return lambda _: code_at(f"estimators.{place}")()


def _of_model(place: str) -> "Callable[[ArmModel], Estimator]":
    return lambda model: code_at(f"estimators.{place}")(model)


def _learned(name: LearnedName, hue: Hue) -> EstimatorRow:
    def build(model: "ArmModel") -> "Estimator":
        built: Estimator = code_at("estimators.learned_forecast:learned_forecast")(name, model)
        return built

    return EstimatorRow(build, hue, "dashdot", fitted_with="innovations_kf")


_FITS: Final = "identification.companions:"

ESTIMATORS: Final[Mapping[EstimatorName, EstimatorRow]] = MappingProxyType(
    {
        "hold": EstimatorRow(_plain("simple:Hold"), "VERMILION", benched=True),
        "hold_last_arrived": EstimatorRow(_plain("simple:HoldLastArrived"), "VERMILION", "dashed"),
        "static_gain": EstimatorRow(_of_model("simple:StaticGain"), "GREEN"),
        "velocity": EstimatorRow(_plain("simple:Velocity"), "PINK", "dashed"),
        "damped_velocity": EstimatorRow(_of_model("simple:DampedVelocity"), "PINK", benched=True),
        "moesp_kf": EstimatorRow(_of_model("moesp_kf:MoespKf"), "VIOLET", benched=True),
        "paper": EstimatorRow(_of_model("paper:paper"), "BROWN", "dashed", _FITS + "fit_paper"),
        "paper_as_printed": EstimatorRow(
            _of_model("paper_as_printed:paper_as_printed"), "AMBER", "dashed", fitted_with="paper"
        ),
        "arx_kf": EstimatorRow(_of_model("moesp_kf:arx_kf"), "BROWN", fit=_FITS + "fit_arx_models", benched=True),
        "innovations_kf": EstimatorRow(
            _of_model("innovations_kf:InnovationsKf"),
            "BLUE",
            fit=_FITS + "fit_movement",
            benched=True,
        ),
        "adaptive_kf": EstimatorRow(
            _of_model("adaptive_kf:AdaptiveKf"), "BLUE", "dotted", fitted_with="innovations_kf"
        ),
        "n4sid_kf": EstimatorRow(
            _of_model("moesp_kf:n4sid_kf"), "VIOLET", "dashed", _FITS + "fit_n4sid", benched=True
        ),
        "direct_ls": EstimatorRow(
            _of_model("direct_ls:direct_ls"), "AMBER", fit=_FITS + "fit_horizons", benched=True
        ),
        "drmf": EstimatorRow(
            _of_model("drmf:drmf"),
            "GREEN",
            "dotted",
            _FITS + "fit_completion",
            slow=True,
            benched=True,
        ),
        "gpr": _learned("gpr", "GREEN"),
        "srlsmf": _learned("srlsmf", "PINK"),
        "srlsmf_l1": _learned("srlsmf_l1", "VERMILION"),
        "transformer": _learned("transformer", "VIOLET"),
        "informer": _learned("informer", "AMBER"),
        "cnn": _learned("cnn", "BLUE"),
    }
)
"""The order of the rows is that of the fits, and of their warnings."""


def build_estimator(name: EstimatorName, model: "ArmModel") -> "Estimator":
    """Return the built-in estimator called ``name`` for the arm that ``model`` describes; raises `DataError`."""
    return ESTIMATORS[name].build(model)


def users_of_fit(name: EstimatorName) -> tuple[EstimatorName, ...]:
    """Return the estimator called ``name`` and those that use its models."""
    return (name, *(other for other, row in ESTIMATORS.items() if row.fitted_with == name))
