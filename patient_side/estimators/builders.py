"""The code of an estimator, by its row in `tis.common.estimators`."""

from importlib import import_module
from typing import TYPE_CHECKING

from tis.common.estimators import ESTIMATORS

if TYPE_CHECKING:
    from tis.patient_side.estimators.protocol import Estimator
    from tis.patient_side.statespace import ArmModel


def build_estimator(name: str, model: "ArmModel") -> "Estimator":
    """Return the built-in estimator called ``name`` for the arm that ``model`` describes; raises `DataError`."""
    row = ESTIMATORS[name]
    module, _, builder = row.code.partition(":")
    build = getattr(import_module(f"tis.patient_side.estimators.{module}"), builder)
    arguments = (*([name] if row.learned else []), *([model] if row.of_model else []))
    built: Estimator = build(*arguments)
    return built
