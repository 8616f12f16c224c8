"""Innovations models made by hand, and movements drawn from them."""

from dataclasses import replace

import numpy as np
from scipy.linalg import solve_discrete_are

from tests.patient_side.arm_models import static_model
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import InnovationsModel
from tis.patient_side.statespace import ArmModel

DEVIATION_M = 1e-4


def movement_model(
    n: int = 4, *, integrated: bool = False, level_step: float = 0.1, seed: int = 0
) -> InnovationsModel:
    """A stable model whose innovations can be told from its outputs: the form of a random system with noises."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n))
    A *= 0.95 / np.max(np.abs(np.linalg.eigvals(A)))
    C, noise, R = rng.normal(size=(3, n)), rng.normal(size=(n, n)), np.eye(3)
    P = solve_discrete_are(A.T, C.T, noise @ noise.T, R)
    expected = C @ P @ C.T + R
    K = A @ P @ C.T @ np.linalg.inv(expected)
    size, ones = DEVIATION_M / np.sqrt(np.trace(expected) / 3), np.ones(1)
    Re = size**2 * (expected + expected.T) / 2
    return InnovationsModel(A, C, K, Re, level_step, 10, np.ones(3), ones, ones, integrated)


def drawn(model: InnovationsModel, n_samples: int, rng: np.random.Generator, level_m: float = 0.03) -> Array:
    """Positions (n_samples, 3) of the model, which was running long before."""
    root, warm = np.linalg.cholesky(model.Re), 200
    e = rng.normal(size=(n_samples + warm, 3)) @ root.T
    drift = model.level_step * rng.normal(size=(n_samples + warm, 3)) @ root.T
    x, b, y = np.zeros(model.order), np.full(3, level_m), np.full(3, level_m)
    positions = []
    for k in range(n_samples + warm):
        y = (y if model.integrated else b) + model.C @ x + e[k]
        x = model.A @ x + model.K @ e[k]
        b = b + drift[k]
        positions.append(y)
    return np.array(positions[warm:])


def moving_arm(innovations: InnovationsModel, relation_m: float = 1e-6) -> ArmModel:
    """An arm that is half its command, up to a deviation ``relation_m``, and moves by itself as told."""
    return replace(static_model(noise_m=relation_m), innovations=innovations)


def joint_covariance(model: InnovationsModel, n_samples: int) -> Array:
    """The covariance (3 N, 3 N) of N successive positions but for a constant, of which nothing is known.

    Worked out from the moving-average coefficients, without any filter.
    """
    past, total = 400, 400 + n_samples
    weights, power = [np.eye(3)], model.K
    for _ in range(total):
        weights.append(model.C @ power)
        power = model.A @ power
    moving = np.zeros((n_samples, total, 3, 3))
    for k in range(n_samples):
        moving[k, : past + k + 1] = weights[past + k :: -1]
    steps = np.arange(n_samples)
    walk = np.minimum.outer(steps, steps) * model.level_step**2
    if model.integrated:
        moving, walk = np.cumsum(moving, axis=0), np.zeros_like(walk)
    rows = (moving @ np.linalg.cholesky(model.Re)).transpose(0, 2, 1, 3).reshape(3 * n_samples, 3 * total)
    return np.asarray(rows @ rows.T + np.kron(walk, model.Re))
