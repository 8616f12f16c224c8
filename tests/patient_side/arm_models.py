"""Models made by hand, and a playback of arrivals for tests of estimators."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from tests.patient_side.learned.models import LEARNED, learned_model
from tis.common.metrics.consistency import CHI2_3_95
from tis.common.units import sample_instant_ns
from tis.patient_side.estimators.protocol import Estimate, Estimator
from tis.patient_side.identification.direct_ls import fit_direct
from tis.patient_side.linear_system import Array, NoiseModel, StateSpace
from tis.patient_side.movement_models import (
    CompletionModel,
    DirectModel,
    Factorisation,
    InnovationsModel,
    InputForecast,
)
from tis.patient_side.playout import Playout
from tis.patient_side.statespace import ArmModel, FilterModel

RATE_HZ = 30
PHASE_NS = 2_000_000
LOST = -1


def growth_m(damping: float, noise_m: float, n_samples: int) -> Array:
    """Forecast errors of a command whose velocity is AR(1): propagated by matrices. (n_samples, 3)."""
    F, e = np.array([[1.0, damping], [0.0, damping]]), np.array([[1.0], [1.0]])
    P, rows = np.zeros((2, 2)), []
    for _ in range(n_samples):
        P = F @ P @ F.T + noise_m**2 * e @ e.T
        rows.append(np.full(3, np.sqrt(P[0, 0])))
    return np.array(rows)


def arm_model(space: StateSpace, noise: NoiseModel, damping: float = 0.9, speed_noise_m: float = 1e-4) -> ArmModel:
    """A model about a zero operating point with an output range of 10 cm, and all that estimators need beside it."""
    beside = FilterModel(space, noise, np.zeros(3), np.zeros(3), space.order == 0)
    return ArmModel(
        hand="left",
        arm="PSM2",
        rate_hz=RATE_HZ,
        method="by hand",
        order=space.order,
        block_rows=10,
        train="own_head",
        space=space,
        x0=np.zeros(space.order),
        noise=noise,
        forecast=InputForecast(damping, 1, growth_m(damping, speed_noise_m, 30)),
        input_offset_m=np.zeros(3),
        output_offset_m=np.zeros(3),
        output_low_m=np.full(3, -0.05),
        output_high_m=np.full(3, 0.05),
        singular_values=np.zeros(0),
        fit_pct=(100.0, 100.0, 100.0),
        spectral_radius=space.spectral_radius(),
        pairing="cross",
        static=space.order == 0,
        innovations=slow_movement(),
        n4sid=beside,
        arx=beside,
        autoregression=slow_movement() if space.order == 0 else None,
        direct=direct_model(),
        learned=tuple(map(learned_model, LEARNED)),
        drmf=completion_model(),
    )


def slow_movement() -> InnovationsModel:
    """A movement whose velocity decays within ten samples: position and position a sample ago."""
    eye, none = np.eye(3), np.zeros((3, 3))
    A = np.block([[1.85 * eye, -0.86 * eye], [eye, none]])
    K = np.vstack([1.85 * eye, eye])
    return InnovationsModel(A, np.hstack([eye, none]), K, 1e-8 * eye, 0.1, 2, np.zeros(0), np.ones(1), np.ones(1))


@cache
def direct_model() -> DirectModel:
    """Moments of a command whose velocity is AR(1)."""
    return fit_direct([random_command(np.random.default_rng(0), 900, 0.9, 1e-4)], RATE_HZ)


def completion_model() -> CompletionModel:
    """A factorisation about as heavy as that of real movement: nearly straight for a few samples, then a walk."""
    steps = np.arange(20.0)
    numbers = Factorisation(8, 1.0, 2, 1e-3, 1e-12, 1e-6, 3)
    covariances = np.array([1e-8, 1e-6, 1e-5])[:, None, None] * np.eye(3)
    moves_m2 = 1e-6 * steps**2 / (1.0 + steps / 5.0)
    return CompletionModel(1, 20, moves_m2, 1000.0, numbers, 13, np.array([1, 5, 13]), covariances)


def static_model(gain: float = 0.5, noise_m: float = 1e-5, damping: float = 0.9) -> ArmModel:
    space = StateSpace(np.zeros((0, 0)), np.zeros((0, 3)), np.zeros((3, 0)), gain * np.eye(3))
    noise = NoiseModel(np.zeros((0, 0)), noise_m**2 * np.eye(3), np.zeros((0, 3)))
    return arm_model(space, noise, damping)


def at_operating_point(model: ArmModel, input_m: Sequence[float], output_m: Sequence[float]) -> ArmModel:
    return replace(model, input_offset_m=np.array(input_m), output_offset_m=np.array(output_m))


def random_space(rng: np.random.Generator, n: int, radius: float = 0.8) -> StateSpace:
    A = rng.normal(size=(n, n))
    A *= radius / np.max(np.abs(np.linalg.eigvals(A)), initial=1e-12)
    return StateSpace(A, rng.normal(size=(n, 3)), rng.normal(size=(3, n)), 0.3 * rng.normal(size=(3, 3)))


def random_noise(rng: np.random.Generator, n: int, q: float, r: float) -> NoiseModel:
    """Process and measurement noise that are correlated."""
    root = rng.normal(size=(n + 3, n + 3)) / np.sqrt(n + 3)
    root[:n] *= q
    root[n:] *= r
    joint = root @ root.T
    return NoiseModel(joint[:n, :n], joint[n:, n:], joint[:n, n:])


def simulate(model: ArmModel, u: Array, rng: np.random.Generator) -> Array:
    """Outputs (N, 3) of the model with its own noise."""
    n, noise = model.space.order, model.noise
    joint = np.block([[noise.Q, noise.S], [noise.S.T, noise.R]])
    draws = rng.multivariate_normal(np.zeros(n + 3), joint, size=len(u), method="svd")
    x, y = np.zeros(n), np.empty((len(u), 3))
    for k in range(len(u)):
        y[k] = model.space.C @ x + model.space.D @ u[k] + draws[k, n:]
        x = model.space.A @ x + model.space.B @ u[k] + draws[k, :n]
    return y


def random_command(rng: np.random.Generator, n_samples: int, damping: float, noise_m: float) -> Array:
    """A command (N, 3) whose velocity is AR(1), the process that damped velocity forecasts best."""
    d, u = np.zeros(3), np.zeros((n_samples, 3))
    for k in range(1, n_samples):
        d = damping * d + noise_m * rng.normal(size=3)
        u[k] = u[k - 1] + d
    return u


@dataclass(frozen=True)
class Streams:
    """Samples u, y (N, 3) and when each arrives, in ns of run time; LOST where it never does.

    ``gripper_rad`` (N,) are the angles of the arm's gripper, where it has one.
    """

    u: Array
    y: Array
    u_arrival_ns: Sequence[int]
    y_arrival_ns: Sequence[int]
    gripper_rad: Array | None = None


def delayed(n: int, delay_ns: int) -> list[int]:
    """Arrivals of n samples that are all equally late."""
    return [sample_instant_ns(i, RATE_HZ) + delay_ns for i in range(n)]


def tick_ns(k: int) -> int:
    return sample_instant_ns(k, RATE_HZ) + PHASE_NS


def truth_at_ticks(y: Array) -> Array:
    instants = [sample_instant_ns(i, RATE_HZ) for i in range(len(y))]
    ticks = [tick_ns(k) for k in range(len(y))]
    return np.stack([np.interp(ticks, instants, axis) for axis in y.T], axis=1)


def inside_95(estimates: Sequence[Estimate], truth: Array) -> list[bool]:
    """Tell of each estimate whether the truth (N, 3) lies in its 95 % ellipsoid."""
    inside = []
    for estimate, at in zip(estimates, truth, strict=True):
        assert estimate.position_m is not None
        assert estimate.covariance_m2 is not None
        error = estimate.position_m - at
        inside.append(float(error @ np.linalg.solve(estimate.covariance_m2, error)) <= CHI2_3_95)
    return inside


def play(estimator: Estimator, streams: Streams, last_first: bool = False) -> list[Estimate]:
    """Run an estimator over all ticks; ``last_first`` turns the order of arrivals within each tick round."""
    events = sorted(
        [(t, 0, i) for i, t in enumerate(streams.u_arrival_ns) if t != LOST]
        + [(t, 1, i) for i, t in enumerate(streams.y_arrival_ns) if t != LOST]
    )
    playout, state, estimates = Playout(RATE_HZ), estimator.initial(), []
    done = 0
    for k in range(len(streams.u)):
        due = done
        while due < len(events) and events[due][0] <= tick_ns(k):
            due += 1
        batch = events[done:due]
        for _, is_arm, i in reversed(batch) if last_first else batch:
            if is_arm:
                angle = None if streams.gripper_rad is None else float(streams.gripper_rad[i])
                playout.arm.add(i, streams.y[i], angle)
            else:
                playout.command.add(i, streams.u[i])
        done = due
        state, estimate = estimator.step(state, playout, tick_ns(k))
        estimates.append(estimate)
    return estimates


def positions(estimates: Sequence[Estimate]) -> Array:
    """Means (N, 3); nan where there is no estimate."""
    return np.array([np.full(3, np.nan) if e.position_m is None else e.position_m for e in estimates])


def ratio_to_hold(estimate: Array, hold: Array, truth: Array) -> float:
    return float(np.sqrt(np.sum((estimate - truth) ** 2) / np.sum((hold - truth) ** 2)))
