"""A user's estimator in the company of the testbed's: it cannot end a run, nor spoil what others get.

An estimator that raises, or answers what is no estimate, has no estimate at that instant and keeps its state; that is
counted, and the first time is told. Only such estimators are guarded: the testbed's own run as they are.
"""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np

from common.errors import Fault, InputError, one_line
from patient_side.estimators.protocol import Estimate
from patient_side.playout import Playout
from patient_side.statespace import ArmModel, Array

Factory = Callable[[ArmModel], Any]
Factories = Mapping[str, Factory]
"""What ``module:factory`` stands for, by that name."""
NOBODYS: Final[Factories] = MappingProxyType({})

_ASYMMETRY: Final = 1e-6
_BELOW_ZERO: Final = -1e-6


class UnusableEstimatorError(InputError):
    """What a ``module:factory`` gives is no estimator."""


class FirstFault(NamedTuple):
    """The first instant at which an estimator failed, and why."""

    t_ns: int
    reason: str


@dataclass
class Guarded:
    """Stands in the place of a user's estimator, under the name that the scenario has for it.

    ``n_faults`` counts the steps of ``n_steps`` that gave no estimate by its own fault. Oracle: estimators that fail
    in every way there is, test_guarded.
    """

    name: str
    inner: Any
    n_steps: int = 0
    n_faults: int = 0
    first: FirstFault | None = None
    told: bool = field(default=False, repr=False)

    def initial(self) -> Any:
        """Return the estimator's initial state; raises `UnusableEstimatorError` when it has none."""
        try:
            return self.inner.initial()
        except (Exception, SystemExit) as error:
            raise UnusableEstimatorError(
                Fault("estimators", self.name, f"initial() raised {one_line(error)}")
            ) from None

    def step(self, state: Any, playout: Playout, now_ns: int) -> tuple[Any, Estimate]:
        """Return what the estimator does; where that is nothing of use, the old state and no estimate."""
        self.n_steps += 1
        try:
            return checked(self.inner.step(state, playout, now_ns))
        except (Exception, SystemExit) as error:
            self.n_faults += 1
            if self.first is None:
                self.first = FirstFault(now_ns, str(error) if isinstance(error, _NoEstimate) else one_line(error))
            return state, Estimate(None)


def build_own(name: str, factory: Factory, model: ArmModel) -> Guarded:
    """Return what a user's factory makes of a model, guarded; raises `UnusableEstimatorError` when it is none."""
    try:
        inner = factory(model)
    except (Exception, SystemExit) as error:
        raise UnusableEstimatorError(
            Fault("estimators", name, f"raised {one_line(error)}, when it was given the model")
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
    """Raise `UnusableEstimatorError` where a user's factory gives no estimator of one of the models."""
    for name, factory in own.items():
        for model in models:
            build_own(name, factory, model)


def checked(answer: Any) -> tuple[Any, Estimate]:
    """Return a step's answer with the estimate as float arrays; raises `_NoEstimate` when it is none.

    A covariance may be singular, and be off symmetry by rounding; one that is more than that, or has a negative
    variance in some direction, is none.
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
    if estimate.covariance_m2 is None:
        return state, Estimate(position_m)
    covariance_m2 = _array(estimate.covariance_m2, (3, 3), "covariance_m2")
    if not _is_positive_definite(covariance_m2.tolist()):
        _check_covariance(covariance_m2)
    return state, Estimate(position_m, covariance_m2)


def _is_positive_definite(rows: list[list[float]]) -> bool:
    """Tell whether a matrix (3, 3) is exactly symmetric and has positive pivots, as nearly all covariances do."""
    (a, d, e), (d_too, b, f), (e_too, f_too, c) = rows
    if d != d_too or e != e_too or f != f_too or not a > 0.0:
        return False
    second, across = b - d * d / a, f - d * e / a
    return second > 0.0 and c - e * e / a - across * across / second > 0.0


def _check_covariance(covariance_m2: Array) -> None:
    """Raise `_NoEstimate` where a covariance is off symmetry, or below zero, by more than rounding."""
    largest = float(np.abs(covariance_m2).max())
    if float(np.abs(covariance_m2 - covariance_m2.T).max()) > _ASYMMETRY * largest:
        raise _NoEstimate("covariance_m2 must be symmetric")
    smallest = float(np.linalg.eigvalsh(covariance_m2)[0])
    if smallest < _BELOW_ZERO * largest:
        raise _NoEstimate(f"covariance_m2 must not be negative in any direction (got {smallest:.3g} m^2 in one)")


class _NoEstimate(Exception):  # noqa: N818  counted, never seen by a user as an exception
    """What a step answered is no estimate, for this reason."""


def _array(value: Any, shape: tuple[int, ...], what: str) -> Array:
    array = np.asarray(value)
    if array.shape != shape:
        raise _NoEstimate(f"{what} must have the shape {shape} (got {array.shape})")
    if array.dtype.kind not in "fiu":
        raise _NoEstimate(f"{what} must be real numbers (got {array.dtype})")
    # a copy: what the estimator does to its own array later is not to change what it has said
    copy: Array = np.array(array, dtype=np.float64)
    if not isfinite(copy.sum()):
        raise _NoEstimate(f"{what} must be finite (got {' '.join(f'{each:.4g}' for each in copy.ravel().tolist())})")
    return copy


def _takes(method: Callable[..., Any], n_arguments: int) -> bool:
    """Tell whether a method can be called with so many arguments; of one that does not say it is believed."""
    try:
        signature = inspect.signature(method)
    except (TypeError, ValueError):
        return True
    try:
        signature.bind(*range(n_arguments))
    except TypeError:
        return False
    return True
