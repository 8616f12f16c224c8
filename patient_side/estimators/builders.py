"""The code of an estimator, by its row in `tis.common.estimators`."""

from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING, Any

from tis.common.estimators import ESTIMATORS, short_name

if TYPE_CHECKING:
    from tis.patient_side.estimators.protocol import Estimator
    from tis.patient_side.statespace import ArmModel


def build_estimator(name: str, model: "ArmModel") -> "Estimator":
    """Return the built-in estimator called ``name`` for the arm that ``model`` describes; raises `DataError`."""
    row = ESTIMATORS[short_name(name)]
    module, _, builder = row.code.partition(":")
    build = getattr(import_module(f"tis.patient_side.estimators.{module}"), builder)
    arguments = (*([short_name(name)] if row.learned else []), *([model] if row.of_model else []))
    built: Any = build(*arguments)
    found: Estimator = built if name == short_name(name) else replace(built, name=name)
    return found
