"""Innovations models made by hand, and movements drawn from them."""

from dataclasses import replace

import numpy as np

from patient_side.statespace import ArmModel, Array, InnovationsModel
from tests.patient_side.arm_models import static_model

DEVIATION_M = 1e-4


def movement_model(
    n: int = 4, *, integrated: bool = False, level_step: float = 0.1, seed: int = 0
) -> InnovationsModel:
    """A stable model with a stable inverse: eigenvalues of A below 0.95, of A - K C below 0.7."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n))
    A *= 0.95 / np.max(np.abs(np.linalg.eigvals(A)))
    C, K = 0.5 * rng.normal(size=(3, n)), 0.5 * rng.normal(size=(n, 3))
    while np.max(np.abs(np.linalg.eigvals(A - K @ C))) > 0.7:
        K = 0.8 * K + 0.2 * A @ np.linalg.pinv(C)
    root = np.eye(3) + 0.3 * rng.normal(size=(3, 3))
    Re = DEVIATION_M**2 * root @ root.T
    ones = np.ones(1)
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


def joint_covariance(model: InnovationsModel, n_samples: int, level_m: float = 10.0) -> Array:
    """The covariance (3 N, 3 N) of N successive positions, of a level, or first position, of deviation ``level_m``.

    Worked out from the moving-average coefficients, without any filter.
    """
    past = 400
    total = past + n_samples
    weights = [np.eye(3)]
    power = model.K
    for _ in range(total):
        weights.append(model.C @ power)
        power = model.A @ power
    moving = np.zeros((3 * n_samples, 3 * total))
    for k in range(n_samples):
        for j in range(past + k + 1):
            moving[3 * k : 3 * k + 3, 3 * j : 3 * j + 3] = weights[past + k - j]
    if model.integrated:
        # the first position is the origin, about which nothing is known
        moving[:3] = 0.0
        moving = np.kron(np.tril(np.ones((n_samples, n_samples))), np.eye(3)) @ moving
        walk = np.zeros((n_samples, n_samples))
    else:
        steps = np.arange(n_samples)
        walk = np.minimum.outer(steps, steps) * model.level_step**2
    return np.asarray(
        moving @ np.kron(np.eye(total), model.Re) @ moving.T
        + np.kron(walk, model.Re)
        + level_m**2 * np.kron(np.ones((n_samples, n_samples)), np.eye(3))
    )
