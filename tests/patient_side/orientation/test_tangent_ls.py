"""Least squares in the tangent space, against numpy's least squares on rows built one by one with SciPy."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.patient_side.orientation.turning import angle_deg, arrived, constant_turn, random_angles, random_turns
from tis.common.metrics.consistency import CHI2_3_95
from tis.common.sources.trajectory import Array
from tis.patient_side.identification.direct_ls import fit_direct
from tis.patient_side.orientation.methods import TangentLs
from tis.patient_side.playout import SourceBuffer
from tis.patient_side.rotations import turned

N_ROWS = 900


@cache
def movement(seed: int) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    return random_turns(rng, N_ROWS), random_angles(rng, N_ROWS)


@cache
def method() -> TangentLs:
    orientations, grippers_rad = movement(0)
    return TangentLs(fit_direct([orientations], 30, turned), fit_direct([grippers_rad[:, None]], 30))


def rows_one_by_one(orientations: Array, lags: list[int], ahead: int, last: int) -> tuple[Array, Array]:
    rotations, z, t = Rotation.from_quat(orientations), [], []
    for k in range(max(method().orientation.lags.tolist()), len(orientations) - last):
        here = rotations[k].inv()
        z.append(np.concatenate([(here * rotations[k - lag]).as_rotvec() for lag in lags]))
        t.append((here * rotations[k + ahead]).as_rotvec())
    return np.array(z), np.array(t)


@pytest.mark.parametrize(("ahead", "lost"), [(3, ()), (15, ()), (3, (597, 594, 588))])
def test_the_estimate_is_that_of_least_squares_on_rows_built_one_by_one(ahead: int, lost: tuple[int, ...]) -> None:
    orientations, grippers_rad = movement(0)
    model = method().orientation
    j = model.horizons.tolist().index(ahead)
    newest = 599
    known = [lag for lag in model.lags.tolist() if newest - lag not in lost][: int(model.n_lags[j])]
    z, t = rows_one_by_one(orientations, known, ahead, int(model.horizons[-1]))
    # ridge: rows of the random walk's root
    step = np.trace(model.past[:3, :3]) / 3
    walk = np.kron(step * np.minimum.outer(known, known), np.eye(3))
    root = np.linalg.cholesky(model.penalty[j] * len(z) * walk).T
    weights = np.linalg.lstsq(np.vstack([z, root]), np.vstack([t, np.zeros((len(root), 3))]))[0]
    seen = Rotation.from_quat(orientations[: newest + 1])
    past = np.concatenate([(seen[newest].inv() * seen[newest - lag]).as_rotvec() for lag in known])
    expected = seen[newest] * Rotation.from_rotvec(past @ weights)
    found = method().estimate(arrived(orientations[:600], grippers_rad[:600], lost), float(ahead))
    assert found.orientation is not None
    assert angle_deg(found.orientation, expected.as_quat()) < 1e-4


def test_signs_of_quaternions_do_not_matter() -> None:
    orientations, grippers_rad = movement(0)
    flipped = orientations * np.where(np.arange(N_ROWS) % 3 == 0, -1.0, 1.0)[:, None]
    one, other = (method().estimate(arrived(q, grippers_rad), 6.0) for q in (orientations, flipped))
    assert one.orientation is not None
    assert other.orientation is not None
    assert angle_deg(one.orientation, other.orientation) < 1e-5


def test_a_constant_turn_is_met_after_training_on_constant_turns() -> None:
    turns = [constant_turn(300, axis, speed) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
             for speed in (20.0, 40.0)]  # fmt: skip
    angles = [np.linspace(0.0, 1.0 + i, 300)[:, None] for i in range(6)]
    trained = TangentLs(fit_direct(turns, 30, turned), fit_direct(angles, 30))
    axis = (1.0, 2.0, -1.0)
    found = trained.estimate(arrived(constant_turn(200, axis, 30.0), 0.01 * np.arange(200)), 6.0)
    assert found.orientation is not None
    truth = constant_turn(1, axis, 30.0, start_deg=30.0 * 205 / 30)[0]
    assert angle_deg(found.orientation, truth) < 0.02  # of 6 degrees
    assert found.gripper_rad == pytest.approx(2.05, abs=1e-3)


@pytest.mark.parametrize("ahead", [1.0, 6.0, 15.0])
def test_on_new_movements_it_beats_hold_and_its_regions_hold_95_per_cent(ahead: float) -> None:
    inside, inside_gripper, squares, held = [], [], 0.0, 0.0
    for seed in range(1, 13):
        orientations, grippers_rad = movement(seed)
        rotations = Rotation.from_quat(orientations)
        for k in range(100, N_ROWS - 20, 20):
            found = method().estimate(arrived(orientations[k - 95 : k + 1], grippers_rad[k - 95 : k + 1]), ahead)
            assert found.orientation is not None
            assert found.covariance_rad2 is not None
            assert found.gripper_rad is not None
            assert found.gripper_variance_rad2 is not None
            truth = rotations[k + int(ahead)]
            error = (Rotation.from_quat(found.orientation).inv() * truth).as_rotvec()
            squares += float(error @ error)
            held += float((rotations[k].inv() * truth).magnitude() ** 2)
            inside.append(error @ np.linalg.solve(found.covariance_rad2, error) <= CHI2_3_95)
            off = found.gripper_rad - grippers_rad[k + int(ahead)]
            inside_gripper.append(off**2 <= 3.841 * found.gripper_variance_rad2)
    assert squares < 0.8 * held
    # 480 forecasts, neighbours hardly dependent: within four binomial deviations of a percentage point
    assert np.mean(inside) == pytest.approx(0.95, abs=0.04)
    assert np.mean(inside_gripper) == pytest.approx(0.95, abs=0.04)


def test_the_covariance_is_positive_definite_and_grows_with_age() -> None:
    buffer = arrived(*movement(3))
    traces = []
    for age in (0.5, 1.0, 2.5, 6.0, 30.0, 100.0, 1000.0):
        found = method().estimate(buffer, age)
        assert found.covariance_rad2 is not None
        assert np.linalg.eigvalsh(found.covariance_rad2)[0] > 0
        traces.append(np.trace(found.covariance_rad2))
    assert traces == sorted(traces)


def test_nothing_before_the_first_sample_and_hold_after_the_first() -> None:
    assert method().estimate(SourceBuffer(8), 0.0).orientation is None
    orientations, grippers_rad = movement(0)
    found = method().estimate(arrived(orientations[:1], grippers_rad[:1]), 6.0)
    assert found.orientation is not None
    assert angle_deg(found.orientation, orientations[0]) < 1e-5
    assert found.gripper_rad == pytest.approx(float(grippers_rad[0]))
