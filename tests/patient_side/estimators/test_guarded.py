"""A user's estimator cannot end a run: whatever it does there is an answer, and what it did wrong is counted."""

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.patient_side.arm_models import static_model
from tis.patient_side.estimators.guarded import (
    Guarded,
    UnusableEstimatorError,
    build_any,
    build_own,
    check_own,
    checked,
)
from tis.patient_side.estimators.protocol import Estimate
from tis.patient_side.playout import Playout
from tis.patient_side.statespace import ArmModel

HERE: Any = np.array([0.1, 0.2, 0.3])
NAME = "lab:F"
TURNED = np.array([[2.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 1.0]])


class Says:
    """An estimator that counts its steps and answers what it is told to."""

    def __init__(self, answer: Callable[[int], Any]) -> None:
        self.answer = answer

    def initial(self) -> int:
        return 0

    def step(self, state: int, playout: Playout, now_ns: int) -> Any:
        return self.answer(state)


def fails(answer: Callable[[int], Any]) -> str:
    """Return what is said of an estimator that does this at its third step, and check that it goes on from there."""
    guarded = Guarded(NAME, Says(lambda state: (state + 1, Estimate(HERE)) if state < 2 else answer(state)))
    state, playout = guarded.initial(), Playout(30)
    seen = []
    for now_ns in (10, 20, 30, 40):
        state, estimate = guarded.step(state, playout, now_ns)
        seen.append(estimate.position_m is not None)
    assert seen == [True, True, False, False]
    assert (state, guarded.n_steps, guarded.n_faults) == (2, 4, 2)
    assert guarded.first is not None
    assert guarded.first.t_ns == 30
    reason, _, line = guarded.first.reason.rpartition(" (test_guarded.py, line ")
    assert line.rstrip(")").isdecimal()
    return reason


def raises(error: BaseException) -> Callable[[int], Any]:
    def answer(state: int) -> Any:
        raise error

    return answer


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        (raises(ZeroDivisionError("division\nby zero")), "ZeroDivisionError: division by zero"),
        (raises(KeyError()), "KeyError"),
        (raises(SystemExit(3)), "SystemExit: 3"),
        (raises(ValueError(300 * "x")), f"ValueError: {185 * 'x'}..."),
        (lambda _: None, "step must return (state, Estimate) (got NoneType)"),
        (lambda _: Estimate(HERE), "step must return (state, Estimate) (got a NoneType in place of the latter)"),
        (lambda s: (s, HERE), "step must return (state, Estimate) (got a ndarray in place of the latter)"),
        (lambda s: (s, Estimate(HERE[None])), "position_m must have the shape (3,) (got (1, 3))"),
        (lambda s: (s, Estimate(HERE * 1j)), "position_m must be real numbers (got complex128)"),
        (lambda s: (s, Estimate(np.array(["a", "b", "c"]))), "position_m must be real numbers (got <U1)"),
        (lambda s: (s, Estimate(HERE * np.nan)), "position_m must be finite (got nan nan nan)"),
        (lambda s: (s, Estimate(np.array([0, np.inf, 0]))), "position_m must be finite (got 0 inf 0)"),
        (lambda s: (s, Estimate(HERE, np.ones(3))), "covariance_m2 must have the shape (3, 3) (got (3,))"),
        (lambda s: (s, Estimate(HERE, np.triu(TURNED))), "covariance_m2 must be symmetric"),
        (
            lambda s: (s, Estimate(HERE, TURNED - 2 * np.eye(3))),
            "covariance_m2 must not be negative in any direction (got -1 m^2 in one)",
        ),
    ],
)  # fmt: skip
def test_what_is_no_estimate_leaves_the_state_and_is_counted_and_told_once(
    answer: Callable[[int], Any], reason: str
) -> None:
    assert fails(answer) == reason


@settings(max_examples=60)
@given(
    st.lists(st.floats(-1, 1), min_size=9, max_size=9),
    st.lists(st.sampled_from([-1.0, -1e-3, 0.0, 1e-12, 1e-3, 1.0]), min_size=3, max_size=3),
    st.sampled_from([1e-9, 1e-4, 1.0]),
)
def test_a_covariance_passes_where_its_eigenvalues_say_so(
    numbers: list[float], variances: list[float], scale: float
) -> None:
    """Oracle: made of the eigenvalues that it is to have, along random axes."""
    axes, _ = np.linalg.qr(np.array(numbers).reshape(3, 3) + 2 * np.eye(3))
    covariance_m2 = scale * (axes * variances) @ axes.T
    guarded = Guarded(NAME, Says(lambda s: (s, Estimate(HERE, covariance_m2))))
    _, estimate = guarded.step(0, Playout(30), 0)
    assert (estimate.covariance_m2 is not None) == (min(variances) >= 0) == (guarded.n_faults == 0)


def test_what_is_right_is_passed_on_in_doubles_that_nobody_else_holds() -> None:
    position_m, covariance_m2 = HERE.astype(np.float32), np.diag([1, 2, 0])
    state, estimate = checked(("s", Estimate(position_m, covariance_m2)))
    position_m[:] = 0
    assert state == "s"
    assert estimate.position_m == pytest.approx(HERE)
    assert estimate.covariance_m2 is not None
    assert [array.dtype.name for array in (estimate.position_m, estimate.covariance_m2)] == ["float64", "float64"]
    assert checked((0, Estimate(None, np.ones(7)))) == (0, Estimate(None))
    assert checked((0, Estimate([1, 2, 3])))[1].covariance_m2 is None  # type: ignore[arg-type]


class Takes:
    def __init__(self, model: ArmModel) -> None:
        self.model = model

    def initial(self) -> int:
        return 0

    def step(self, state: int, playout: Playout, now_ns: int) -> tuple[int, Estimate]:
        return state, Estimate(self.model.output_offset_m)


class Lacks:
    initial = 3

    def __init__(self, model: ArmModel) -> None: ...


class NoState(Takes):
    def initial(self) -> int:
        sys.exit(4)


class Narrow(Takes):
    def step(self, playout: Playout) -> None: ...  # type: ignore[override]


def refuses(model: ArmModel) -> None:
    raise LookupError("no such arm")


@pytest.mark.parametrize(
    ("factory", "rule"),
    [
        (refuses, "raised LookupError: no such arm (test_guarded.py, line 152), when it was given the model"),
        (lambda: None, "raised TypeError: "),
        (lambda _: 3, "must give an object with the methods initial and step, and both are missing (got 'int')"),
        (lambda _: Takes, "its initial must take nothing (beside self)"),  # the class, and not what it makes
        (Lacks, "must give an object with the methods initial and step, and both are missing (got 'Lacks')"),
        (NoState, "initial() raised SystemExit: 4"),
        (Narrow, "its step must take state, playout, now_ns (beside self)"),
    ],
)
def test_what_is_no_estimator_is_refused_before_the_run(factory: Callable[..., Any], rule: str) -> None:
    with pytest.raises(UnusableEstimatorError) as caught:
        check_own({NAME: factory}, [static_model()])
    (fault,) = caught.value.faults
    assert str(fault).startswith(f"estimators: {NAME}: {rule}")
    assert caught.value.exit_code == 2


def test_an_own_one_is_guarded_and_ours_are_as_they_were() -> None:
    model = static_model()
    own = build_any(NAME, model, {NAME: Takes})
    assert isinstance(own, Guarded)
    assert own.name == NAME
    assert own.step(0, Playout(30), 0)[1].position_m == pytest.approx(model.output_offset_m)
    assert not isinstance(build_any("damped_velocity", model, {NAME: Takes}), Guarded)
    assert build_own(NAME, Takes, model).n_faults == 0
