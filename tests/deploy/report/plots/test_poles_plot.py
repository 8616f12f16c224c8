"""Poles of models with known ones."""

from dataclasses import replace

import numpy as np
import pytest

from tests.patient_side.arm_models import static_model
from tis.deploy.report.plots.models import poles_figure, poles_of
from tis.patient_side.linear_system import StateSpace


def _with_poles(A: np.ndarray) -> StateSpace:
    n = len(A)
    return StateSpace(A, np.zeros((n, 3)), np.zeros((3, n)), np.zeros((3, 3)))


def test_a_static_model_has_none() -> None:
    model = replace(static_model(), innovations=None)
    assert poles_of(model) == {}
    assert poles_figure(model) is None


def test_poles_are_those_of_the_matrix_and_the_slowest_is_told() -> None:
    A = np.array([[0.9 * np.cos(0.3), -0.9 * np.sin(0.3), 1], [0.9 * np.sin(0.3), 0.9 * np.cos(0.3), 0], [0, 0, 0.5]])
    model = replace(static_model(), space=_with_poles(A), order=3, static=False, innovations=None)
    ((poles, _),) = poles_of(model).values()
    assert sorted(poles, key=lambda z: (z.real, z.imag)) == pytest.approx(
        [0.5, 0.9 * np.exp(-0.3j), 0.9 * np.exp(0.3j)]
    )
    found = poles_figure(model)
    assert found is not None
    # log(1/2) / log(0.9) = 6.58 samples of 1/30 s
    words = "The arm under its command has 3 poles; the motion of the slowest, of modulus 0.9000, halves in 219.3 ms."
    assert words in found.caption


def test_a_pole_on_the_circle_does_not_decay() -> None:
    model = replace(static_model(), space=_with_poles(np.eye(1)), order=1, static=False, innovations=None)
    found = poles_figure(model)
    assert found is not None
    assert "has 1 pole; the motion of the slowest, of modulus 1.0000, does not decay." in found.caption


def test_a_triple_pole_is_one_cross_and_that_is_said() -> None:
    A = np.kron(np.diag([0.5, 0.9]), np.eye(3))
    model = replace(static_model(), space=_with_poles(A), order=6, static=False, innovations=None)
    found = poles_figure(model)
    assert found is not None
    assert "has 6 poles but 2 crosses, since each is triple; the motion of the slowest" in found.caption
    uneven = replace(model, space=_with_poles(np.diag([0.5, 0.5, 0.9])), order=3)
    found = poles_figure(uneven)
    assert found is not None
    assert "has 3 poles but 2 crosses, since some lie on each other" in found.caption
