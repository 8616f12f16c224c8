"""Damped rates against a plain loop over SciPy's rotations, and on movements whose rate is known."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.patient_side.orientation.turning import constant_turn, random_angles, random_turns
from tis.common.sources.trajectory import Array
from tis.patient_side.identification.direct_ls import differences
from tis.patient_side.identification.fit_wrist import fit_rate
from tis.patient_side.rotations import turned


def test_a_constant_turn_is_not_damped_and_leaves_no_error() -> None:
    found = fit_rate([constant_turn(300, (1.0, 1.0, 0.0), 20.0)], 30, turned)
    assert found.damping == 1.0
    assert found.stride == 1
    assert np.abs(found.covariance).max() < 1e-9


@pytest.mark.parametrize("damping", [0.6, 0.9])
def test_the_damping_of_a_rate_that_decays_is_found(damping: float) -> None:
    rng = np.random.default_rng(2)
    turns = [random_turns(rng, 1500, damping) for _ in range(6)]
    assert fit_rate(turns, 30, turned).damping == pytest.approx(damping, abs=0.05)
    angles = [random_angles(rng, 1500, damping)[:, None] for _ in range(6)]
    assert fit_rate(angles, 30, differences).damping == pytest.approx(damping, abs=0.05)


def test_the_choice_is_that_of_a_plain_loop() -> None:
    orientations = random_turns(np.random.default_rng(5), 250, 0.8)
    found = fit_rate([orientations], 30, turned)
    rotations = Rotation.from_quat(orientations)
    costs = {}
    for span in (1, 2, 3):
        pairs: dict[int, tuple[Array, Array]] = {}
        for horizon in (1, 3, 6, 15, 30, 60):
            now = range(3, len(orientations) - horizon)
            rates = [(rotations[k - span].inv() * rotations[k]).as_rotvec() / span for k in now]
            moves = [(rotations[k].inv() * rotations[k + horizon]).as_rotvec() for k in now]
            pairs[horizon] = np.array(rates), np.array(moves)
        for damping in np.linspace(0.0, 1.0, 101):
            shares = []
            for horizon, (rate, ahead) in pairs.items():
                steps = sum(damping**k for k in range(1, horizon + 1))
                shares.append(np.sum((ahead - steps * rate) ** 2) / np.sum(ahead**2))
            costs[span, round(float(damping), 2)] = float(np.mean(shares))
    span, damping = min(costs, key=lambda each: costs[each])
    assert found.velocity_span == span
    assert found.damping == pytest.approx(damping, abs=0.006)  # the loop's grid is ten times coarser


def test_at_a_higher_rate_a_step_is_a_thirtieth_of_a_second() -> None:
    slow = random_turns(np.random.default_rng(1), 400)
    found = fit_rate([np.repeat(slow, 4, axis=0)], 120, turned)
    assert found.stride == 4
    assert found.horizons.tolist()[:3] == [1.0, 2.0, 3.0]
