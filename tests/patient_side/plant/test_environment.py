"""Walls and tissue: published figures, a cycle's loss by quadrature, and geometry."""

import numpy as np
import pytest
from scipy.integrate import quad

from tis.common.scenario.touch import TissueEnvironment, WallEnvironment
from tis.patient_side.plant.environment import Tissue, Wall, environment_of

LIVER = TissueEnvironment(kind="tissue", shear_modulus_kpa=1.8, tip_radius_mm=4.0, loss_s_m=0.8)


def test_liver_and_tumour_press_back_as_published() -> None:
    """Shear moduli of 1.8 and 23.4 kPa, a tip of 4 mm, 5 mm deep."""
    tissue = Tissue.of(LIVER)
    assert tissue.k == pytest.approx(607, rel=2e-3)
    assert tissue.force_n(0.005, 0.0) == pytest.approx(0.21, rel=0.03)
    hard = LIVER.model_copy(update={"shear_modulus_kpa": 23.4})
    assert Tissue.of(hard).force_n(0.005, 0.0) == pytest.approx(2.8, rel=0.02)


def test_a_cycle_loses_what_quadrature_says() -> None:
    """Depth A (1 - cos wt) / 2: the loss is the integral of 1.5 c k d^1.5 d'^2."""
    tissue, deep_m, w = Tissue.of(LIVER), 0.004, 2 * np.pi
    t = np.linspace(0, 1, 20_001)
    depth, speed = deep_m * (1 - np.cos(w * t)) / 2, deep_m * w * np.sin(w * t) / 2
    force = np.array([tissue.force_n(d, v) for d, v in zip(depth.tolist(), speed.tolist(), strict=True)])
    lost = np.trapezoid(force * speed, t)

    def rate(at: float) -> float:
        d, v = deep_m * (1 - np.cos(w * at)) / 2, deep_m * w * np.sin(w * at) / 2
        return float(1.5 * LIVER.loss_s_m * tissue.k * d**1.5 * v**2)

    assert lost == pytest.approx(quad(rate, 0, 1)[0], rel=1e-3)


def test_a_wall_pushes_and_never_pulls() -> None:
    wall = Wall(400.0, 5.0)
    assert wall.force_n(0.002, 0.0) == pytest.approx(0.8)
    assert wall.force_n(0.001, -1.0) == 0.0


def test_a_wall_that_is_turned_turns_the_force() -> None:
    turned = environment_of(WallEnvironment(kind="wall", normal=(2.0, 0.0, 2.0), position_mm=(0, 0, 0)))
    half = np.sqrt(0.5)
    force = turned.force(turned.surface_m((9.0, 9.0, 9.0)), (-half * 0.01, 0.3, -half * 0.01), (0.0, 0.0, 0.0))
    assert force == pytest.approx((half * 4.0, 0.0, half * 4.0))


def test_a_plane_lies_before_the_first_set_point_or_where_it_is_placed() -> None:
    ahead = environment_of(WallEnvironment(kind="wall", normal=(0, 0, 3), distance_mm=5))
    assert ahead.surface_m((0.1, 0.2, 0.3)) == pytest.approx((0.1, 0.2, 0.295))
    assert environment_of(WallEnvironment(kind="wall")).surface_m((0.0, 0.0, 0.0)) == pytest.approx((0, 0, -0.005))
