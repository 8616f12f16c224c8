"""The estimators on a recorded trial; the model is made by hand from the rows that come before."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.patient_side.arm_models import (
    LOST,
    RATE_HZ,
    Streams,
    delayed,
    play,
    positions,
    ratio_to_hold,
    static_model,
    truth_at_ticks,
)
from tis.common.units import sample_instant_ns
from tis.patient_side.estimators.builders import build_estimator
from tis.patient_side.linear_system import Array, NoiseModel, StateSpace
from tis.patient_side.movement_models import InputForecast
from tis.patient_side.statespace import ArmModel

TRAIN = 1240
DAMPING = 0.85


def fitted(u: Array, y: Array) -> ArmModel:
    """A static relation by least squares, with the errors of the damped-velocity forecast on the same rows."""
    u0, y0 = u.mean(axis=0), y.mean(axis=0)
    D = np.linalg.lstsq(u - u0, y - y0, rcond=None)[0].T
    residual = y - y0 - (u - u0) @ D.T
    velocity, growth = np.diff(u, axis=0), []
    for h in range(1, 31):
        ahead = u[1:-h] + velocity[:-h] * sum(DAMPING**i for i in range(1, h + 1))
        growth.append(np.sqrt(np.mean((u[1 + h :] - ahead) ** 2, axis=0)))
    none = np.zeros((0, 0))
    return replace(
        static_model(),
        space=StateSpace(none, np.zeros((0, 3)), np.zeros((3, 0)), D),
        noise=NoiseModel(none, residual.T @ residual / len(residual), np.zeros((0, 3))),
        forecast=InputForecast(DAMPING, 1, np.array(growth)),
        input_offset_m=u0,
        output_offset_m=y0,
        output_low_m=y.min(axis=0),
        output_high_m=y.max(axis=0),
    )


@pytest.fixture(scope="module")
def trial(jigsaws_dir: Path) -> tuple[ArmModel, Array, Array]:
    rows = np.loadtxt(jigsaws_dir / "Suturing" / "kinematics" / "AllGestures" / "Suturing_D002.txt")
    u, y = rows[:, 0:3], rows[:, 57:60]
    return fitted(u[:TRAIN], y[:TRAIN]), u[TRAIN:], y[TRAIN:]


def ratio(name: str, model: ArmModel, streams: Streams) -> float:
    scored = slice(70, -1)
    estimates = positions(play(build_estimator(name, model), streams))[scored]
    assert np.all(np.isfinite(estimates))
    hold = positions(play(build_estimator("hold", model), streams))[scored]
    return ratio_to_hold(estimates, hold, truth_at_ticks(streams.y)[scored])


@pytest.mark.parametrize(("delay_ms", "bound"), [(33, 0.50), (100, 0.50), (200, 0.65), (500, 0.90)])
def test_constant_delay(trial: tuple[ArmModel, Array, Array], delay_ms: int, bound: float) -> None:
    model, u, y = trial
    arrivals = delayed(len(u), delay_ms * 1_000_000)
    filtered = ratio("moesp_kf", model, Streams(u, y, arrivals, arrivals))
    assert filtered <= bound


def test_commands_without_delay_tell_nearly_all(trial: tuple[ArmModel, Array, Array]) -> None:
    model, u, y = trial
    assert ratio("moesp_kf", model, Streams(u, y, delayed(len(u), 0), delayed(len(u), 200_000_000))) < 0.02


@pytest.mark.parametrize("seed", [1, 2])
def test_loss_and_jitter(trial: tuple[ArmModel, Array, Array], seed: int) -> None:
    model, u, y = trial
    rng = np.random.default_rng(seed)

    def arrivals() -> list[int]:
        late_ns, lost = rng.integers(50_000_000, 150_000_000, len(u)), rng.random(len(u)) < 0.2
        return [LOST if lost[i] else sample_instant_ns(i, RATE_HZ) + int(late_ns[i]) for i in range(len(u))]

    assert ratio("moesp_kf", model, Streams(u, y, arrivals(), arrivals())) < 0.6


def test_delay_from_200_to_5000_ms_a_packet(trial: tuple[ArmModel, Array, Array]) -> None:
    model, u, y = trial
    rng = np.random.default_rng(3)

    def arrivals() -> list[int]:
        late_ns = rng.integers(200_000_000, 5_000_000_000, len(u))
        return [sample_instant_ns(i, RATE_HZ) + int(late_ns[i]) for i in range(len(u))]

    assert ratio("moesp_kf", model, Streams(u, y, arrivals(), arrivals())) < 0.95
