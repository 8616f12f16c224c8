"""A guard around user-defined estimators: their faults neither end a run nor affect other estimators.

A step that raises, or returns something that is no estimate, yields no estimate and keeps the old state; faults are
counted, and the first one is reported. Built-in estimators run without a guard.
"""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from pathlib import PurePath
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np

from tis.common.errors import Fault, InputError, one_line, place_of
from tis.common.messages import MAX_SIZE
from tis.common.scenario.estimator_names import is_built_in
from tis.patient_side.estimators.builders import build_estimator
from tis.patient_side.estimators.protocol import Estimate, Estimator
from tis.patient_side.linear_system import Array
from tis.patient_side.playout import Playout
from tis.patient_side.statespace import ArmModel

Factory = Callable[[ArmModel], Any]
Factories = Mapping[str, Factory]
"""The factory behind each ``module:factory``, by that name."""
NO_FACTORIES: Final[Factories] = MappingProxyType({})

_MAX_ASYMMETRY: Final = 1e-6
_MIN_EIGENVALUE: Final = -1e-6


class UnusableEstimatorError(InputError):
    """A ``module:factory`` returns no estimator."""


class FirstFault(NamedTuple):
    """The first instant at which an estimator failed, and why."""

    t_ns: int
    reason: str


@dataclass
class Guarded:
    """A user-defined estimator under its name in the scenario.

    ``n_faults`` counts the steps, of ``n_steps``, that failed; ``reported`` is set once the first fault is logged.
    Oracle: estimators with every kind of fault, test_guarded.
    """

    name: str
    inner: Any
    n_steps: int = 0
    n_faults: int = 0
    first: FirstFault | None = None
    reported: bool = field(default=False, repr=False)

    def initial(self) -> Any:
        """Return the estimator's initial state; raises `UnusableEstimatorError` where ``initial`` fails."""
        try:
            return self.inner.initial()
        except (Exception, SystemExit) as error:
            raise UnusableEstimatorError(Fault("estimators", self.name, f"initial() raised {_told(error)}")) from None

    def step(self, state: Any, playout: Playout, now_ns: int) -> tuple[Any, Estimate]:
        """Return the estimator's new state and estimate; after a fault the old state and no estimate."""
        self.n_steps += 1
        try:
            return checked(self.inner.step(state, playout, now_ns))
        except (Exception, SystemExit) as error:
            self.n_faults += 1
            if self.first is None:
                self.first = FirstFault(now_ns, self._reason(error))
            return state, Estimate(None)

    def _reason(self, error: BaseException) -> str:
        """Return why a step failed, with the line of the user's code; of a wrong answer that of the method."""
        if not isinstance(error, _NoEstimate):
            return _told(error)
        code = getattr(self.inner.step, "__code__", None)
        place = "" if code is None else f" ({PurePath(code.co_filename).name}, line {code.co_firstlineno})"
        return f"{error}{place}"


def _told(error: BaseException) -> str:
    return f"{one_line(error)}{place_of(error, __file__)}"


def build_any(name: str, model: ArmModel, own: Factories) -> Estimator:
    """Return the estimator called ``name``: a built-in one, or a user-defined one by ``own``, see `build_own`."""
    return build_estimator(name, model) if is_built_in(name) else build_own(name, own[name], model)


def build_own(name: str, factory: Factory, model: ArmModel) -> Guarded:
    """Return the guarded estimator that a user's factory builds from a model; raises `UnusableEstimatorError`."""
    try:
        inner = factory(model)
    except (Exception, SystemExit) as error:
        raise UnusableEstimatorError(
            Fault("estimators", name, f"raised {_told(error)}, when it was given the model")
        ) from None
    lacking = [method for method in ("initial", "step") if not callable(getattr(inner, method, None))]
    if lacking:
        missing = "both are" if len(lacking) > 1 else f"{lacking[0]} is"
        what = f"must give an object with the methods initial and step, and {missing} missing"
        raise UnusableEstimatorError(Fault("estimators", name, what, type(inner).__name__))
    for method, arguments in (("initial", ()), ("step", ("state", "playout", "now_ns"))):
        if not _takes(getattr(inner, method), len(arguments)):
            rule = f"its {method} must take {', '.join(arguments) or 'nothing'} (beside self)"
            raise UnusableEstimatorError(Fault("estimators", name, rule))
    guarded = Guarded(name, inner)
    guarded.initial()
    return guarded


def check_own(own: Factories, models: Sequence[ArmModel]) -> None:
    """Raise `UnusableEstimatorError` where a user's factory returns no estimator for one of the models."""
    for name, factory in own.items():
        for model in models:
            build_own(name, factory, model)


def checked(answer: Any) -> tuple[Any, Estimate]:
    """Return a step's answer with the estimate as float arrays; raises `_NoEstimate` when it is none.

    A covariance may be singular, and asymmetric by rounding; one with a larger asymmetry, or with a negative variance
    in some direction, is rejected.
    """
    if not isinstance(answer, tuple) or len(answer) != 2:
        raise _NoEstimate(f"step must return (state, Estimate) (got {type(answer).__name__})")
    state, estimate = answer
    if not isinstance(estimate, Estimate):
        raise _NoEstimate(
            f"step must return (state, Estimate) (got a {type(estimate).__name__} in place of the latter)"
        )
    if estimate.position_m is None:
        return state, Estimate(None)
    position_m = _array(estimate.position_m, (3,), "position_m")
    if (largest := float(np.abs(position_m).max())) > MAX_SIZE:
        raise _NoEstimate(f"position_m must lie within {MAX_SIZE:g} m (got {largest:.4g})")
    if estimate.covariance_m2 is None:
        return state, Estimate(position_m)
    covariance_m2 = _array(estimate.covariance_m2, (3, 3), "covariance_m2")
    if not _is_positive_definite(covariance_m2.tolist()):
        _check_covariance(covariance_m2)
    return state, Estimate(position_m, covariance_m2)


def _is_positive_definite(rows: list[list[float]]) -> bool:
    """Return whether a matrix (3, 3) is exactly symmetric with positive pivots: a fast test that most pass."""
    (a, d, e), (d_too, b, f), (e_too, f_too, c) = rows
    if d != d_too or e != e_too or f != f_too or not a > 0.0:
        return False
    second, across = b - d * d / a, f - d * e / a
    return second > 0.0 and c - e * e / a - across * across / second > 0.0


def _check_covariance(covariance_m2: Array) -> None:
    """Raise `_NoEstimate` where a covariance is asymmetric, or negative in a direction, by more than rounding."""
    largest = float(np.abs(covariance_m2).max())
    if float(np.abs(covariance_m2 - covariance_m2.T).max()) > _MAX_ASYMMETRY * largest:
        raise _NoEstimate("covariance_m2 must be symmetric")
    smallest = float(np.linalg.eigvalsh(covariance_m2)[0])
    if smallest < _MIN_EIGENVALUE * largest:
        raise _NoEstimate(f"covariance_m2 must not be negative in any direction (got {smallest:.3g} m^2 in one)")


class _NoEstimate(Exception):  # noqa: N818  counted, never seen by a user as an exception
    """A step's answer is no estimate, for this reason."""


def _array(value: Any, shape: tuple[int, ...], what: str) -> Array:
    array = np.asarray(value)
    if array.shape != shape:
        raise _NoEstimate(f"{what} must have the shape {shape} (got {array.shape})")
    if array.dtype.kind not in "fiu":
        raise _NoEstimate(f"{what} must be real numbers (got {array.dtype})")
    # A copy: later changes of the estimator's own array must not change an estimate that is already published.
    copy: Array = np.array(array, dtype=np.float64)
    if not isfinite(copy.sum()):
        raise _NoEstimate(f"{what} must be finite (got {' '.join(f'{each:.4g}' for each in copy.ravel().tolist())})")
    return copy


def _takes(method: Callable[..., Any], n_arguments: int) -> bool:
    """Return whether a method can be called with so many arguments; assumed where it has no signature."""
    try:
        signature = inspect.signature(method)
    except (TypeError, ValueError):
        return True
    try:
        signature.bind(*range(n_arguments))
    except TypeError:
        return False
    return True
