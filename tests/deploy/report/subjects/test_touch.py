"""Figures of touch by hand: stability of swings of known growth, energy, displayed stiffness, and theory's limit."""

from math import inf, pi

import numpy as np
import pytest
from numpy.typing import NDArray

from tis.common.coupling.stability import Arm, Limb, loop_limit
from tis.common.scenario import Scenario
from tis.deploy.logs.read.frame import Frame
from tis.deploy.report.subjects.touch import Stability, energy_j, predicted_limit, stability
from tis.deploy.run.resolve import resolve

RATE_HZ = 200
Array = NDArray[np.float64]


def _shown(off_m: Array, force_n: Array, intended_m: Array | None = None, limited: str = "") -> Frame:
    """Forces and places along z; the intention rests unless it is given."""
    n = len(off_m)
    intended = np.zeros(n) if intended_m is None else intended_m

    def along_z(values: Array) -> Array:
        return np.column_stack([np.zeros(n), np.zeros(n), values])

    return Frame.of_arrays(
        tick=np.arange(n),
        position_m=along_z(intended + off_m),
        intended_m=along_z(intended),
        force_n=along_z(force_n),
        limited=np.full(n, limited),
    )


def _swing(growth_per_s: float, seconds: float = 6.0) -> Array:
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    return np.asarray(1e-3 * np.exp(growth_per_s * t) * np.sin(2 * pi * 4 * t))


@pytest.mark.parametrize(("growth_per_s", "found"), [(0.8, "unstable"), (-0.8, "stable")])
def test_a_swing_that_grows_is_unstable_and_one_that_decays_is_not(growth_per_s: float, found: Stability) -> None:
    off = _swing(growth_per_s)
    assert stability(_shown(off, np.full(len(off), 1.0)), RATE_HZ) == found


def test_a_force_that_its_limit_cuts_for_long_is_instability() -> None:
    off = _swing(0.0)
    assert stability(_shown(off, np.full(len(off), 20.0), limited="force"), RATE_HZ) == "unstable"


def test_without_contact_or_with_little_of_it_nothing_is_decided() -> None:
    off = _swing(0.0)
    assert stability(_shown(off, np.zeros(len(off))), RATE_HZ) == "not_decidable"
    short = np.zeros(len(off))
    short[:100] = 1.0
    assert stability(_shown(off, short), RATE_HZ) == "not_decidable"


def test_a_hand_that_moves_as_fast_as_it_intends_is_stable() -> None:
    t = np.arange(6 * RATE_HZ) / RATE_HZ
    moves = 0.01 * np.sin(2 * pi * t)
    assert stability(_shown(0.2 * moves, np.abs(moves) * 100, moves), RATE_HZ) == "stable"


def test_energy_is_the_hands_force_times_its_movement() -> None:
    """Against a force of 2 N the hand goes in by 10 mm, and is pushed out by 5 mm under 6 N."""
    place = np.array([0.0, -0.005, -0.010, -0.005])
    shown = _shown(place, np.array([2.0, 2.0, 6.0, 6.0]))
    assert energy_j(shown) == pytest.approx([0.0, 0.010, 0.020, -0.010])


def test_theory_is_asked_where_it_holds() -> None:
    scenario = resolve("touch", (), None, None)
    limb, arm = Limb(0.9, 6.0, 568.0), Arm(10.0, 1.0, 0.3)
    assert predicted_limit(scenario, 0.012) == pytest.approx(loop_limit(limb, arm, 0.012, 1e-3)) != inf

    def without(*settings: str) -> Scenario:
        return resolve("touch", settings, None, None)

    assert predicted_limit(without("touch.coupling=wave"), 0.012) is None
    assert predicted_limit(without("patient.plant={kind: mujoco}"), 0.012) is None
