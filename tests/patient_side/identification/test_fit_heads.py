"""Heads of several people: what is found where the tool tells where the hand goes, and where it does not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.patient_side.arm_models import RATE_HZ
from tests.patient_side.identification.test_fit_innovations import returning
from tests.patient_side.movements import drawn
from tis.patient_side.filters.heads import LENGTHS, Kernel
from tis.patient_side.identification.fit_correction import ridge
from tis.patient_side.identification.fit_heads import root_of
from tis.patient_side.identification.level_and_scale import HeldBack, with_scale
from tis.patient_side.linear_system import Array

N = 900
PEOPLE = ("A", "A", "B", "B", "C", "C")


def told(y: Array, ahead: int) -> Array:
    """Orientations whose axis leans to where the hand will be ``ahead`` samples later."""
    later = np.vstack([y[ahead:], np.repeat(y[-1:], ahead, axis=0)]) - y
    lean = later / (2.0 * later.std(axis=0))
    return Rotation.from_rotvec(0.4 * np.column_stack([lean[:, 1], -lean[:, 0], lean[:, 2]])).as_quat()


def held(*, tells: bool, people: tuple[str, ...] = PEOPLE) -> HeldBack:
    rng = np.random.default_rng(5)
    outputs = tuple(drawn(returning(), N, rng) for _ in people)
    turns = tuple(told(y, 6) if tells else np.tile([0.0, 0.0, 0.0, 1.0], (N, 1)) for y in outputs)
    grippers = tuple(np.zeros(N) for _ in people)
    return HeldBack(outputs, (700,) * len(people), grippers, people, orientations=turns)


def gain(rows: HeldBack) -> tuple[float, int]:
    found = with_scale(returning(), rows, RATE_HZ, corrected=True)
    assert found.model.correction is not None
    at = int(np.argmin(np.abs(found.steps - 6)))
    return float(found.gain[at]), len(found.model.correction.heads)


def test_what_the_tool_tells_of_the_hand_is_found_and_nothing_else() -> None:
    telling, n_heads = gain(held(tells=True))
    assert n_heads == 2
    assert telling < 0.85
    silent, _ = gain(held(tells=False))
    assert silent == pytest.approx(1.0, abs=0.01)


def test_with_every_row_a_landmark_it_is_kernel_ridge_regression() -> None:
    rng, prior, alike = np.random.default_rng(6), 10.0, 3.0
    inputs, errors = rng.normal(size=(40, 5)), rng.normal(size=(40, 3))
    squares = np.sum((inputs[:, None] - inputs) ** 2, axis=2)
    exact = np.exp(-squares / (2.0 * LENGTHS[1] ** 2))
    expected = exact @ np.linalg.solve(exact + alike / prior * np.eye(40), errors)
    kernel = Kernel.of(1, np.zeros(5), np.ones(5), inputs)
    features = kernel.rows(inputs) @ root_of(kernel.rows(inputs))
    precision = alike / (prior * np.mean(features**2, axis=0))
    square = float(np.sum(errors**2)) / 3
    found = ridge(features.T @ features, features.T @ errors, square, 40.0, precision)
    assert features @ found == pytest.approx(expected, abs=2e-3)


def test_fewer_than_three_people_or_unknown_orientations_give_no_heads() -> None:
    rows = held(tells=True)
    assert gain(replace(rows, people=("A", "A", "A", "B", "B", "B")))[1] == 0
    assert gain(replace(rows, people=()))[1] == 0
    assert gain(replace(rows, orientations=()))[1] == 0
