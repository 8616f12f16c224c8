from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_discrete_are

from tests.patient_side.arm_models import arm_model, growth_m, random_noise, random_space, static_model
from tis.patient_side.filters.kalman import (
    NOISE_FLOOR_M,
    AugmentedModel,
    augment,
    initial_belief,
    input_noise,
    predict,
    predict_ahead,
    set_command,
    start_at,
    update,
)
from tis.patient_side.linear_system import Array, NoiseModel
from tis.patient_side.movement_models import InputForecast
from tis.patient_side.statespace import ArmModel


def dynamic_model(seed: int, n: int = 3) -> ArmModel:
    rng = np.random.default_rng(seed)
    return arm_model(random_space(rng, n), random_noise(rng, n, 1.0, 0.5), speed_noise_m=0.3)


def conditioned(model: AugmentedModel, P0: Array, outputs: dict[int, Array], stop: int) -> tuple[Array, Array]:
    """Mean and covariance of z[stop] given all outputs at once, without any recursion.

    z and y are written as linear maps of all the noises (z[0], w[0], v[0], w[1], v[1], ...), which are jointly
    normal with cov(w[k], v[k]) = S; then the textbook formula for a conditional normal distribution applies.
    """
    size = len(model.F)
    total = size + (stop + 1) * (size + 3)
    joint = np.zeros((total, total))
    joint[:size, :size] = P0
    block = np.block([[model.Q_ahead, model.S], [model.S.T, model.R]])
    state, rows = np.eye(size, total), []
    for k in range(stop + 1):
        begin = size + k * (size + 3)
        joint[begin : begin + size + 3, begin : begin + size + 3] = block
        if k in outputs:
            measured = model.H @ state
            measured[:, begin + size : begin + size + 3] += np.eye(3)
            rows.append(measured)
        if k < stop:
            state = model.F @ state
            state[:, begin : begin + size] += np.eye(size)
    Y, y = np.vstack(rows), np.concatenate([outputs[k] for k in sorted(outputs)])
    gain = np.linalg.solve(Y @ joint @ Y.T, Y @ joint @ state.T).T
    return gain @ y, state @ joint @ state.T - gain @ Y @ joint @ state.T


@pytest.mark.parametrize("seed", range(5))
def test_filter_equals_conditioning_at_once(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    model = augment(dynamic_model(seed, n=seed), horizon=10)
    model = replace(model, P0=model.P0 / np.max(model.P0))  # both methods in the same well-scaled numbers
    outputs = {k: rng.normal(size=3) for k in (0, 1, 4, 5, 7)}
    belief = initial_belief(model)
    for k in range(9):
        if k:
            predict(belief, model, outputs.get(k - 1), ahead=True)
        if k in outputs:
            update(belief, model, outputs[k])
    mean, covariance = conditioned(model, model.P0, outputs, 8)
    scale = float(np.max(np.abs(covariance)))
    assert belief.x == pytest.approx(mean, abs=1e-10 * max(1.0, float(np.max(np.abs(mean)))))
    assert np.allclose(belief.P, covariance, rtol=0, atol=1e-10 * max(1.0, scale))


@pytest.mark.parametrize("seed", range(3))
def test_steady_state_solves_the_riccati_equation(seed: int) -> None:
    model = augment(dynamic_model(seed), horizon=10)
    belief = initial_belief(model)
    for _ in range(4000):
        set_command(belief, model, np.zeros(3), 0, np.zeros(3))
        update(belief, model, np.zeros(3))
        predict(belief, model, np.zeros(3), ahead=False)
    part = slice(0, model.bias.stop)  # the command is known: only states and bias are uncertain
    P = solve_discrete_are(model.F[part, part].T, model.H[:, part].T, model.Q[part, part], model.R, s=model.S[part])
    assert np.allclose(belief.P[part, part], P, rtol=1e-7, atol=1e-9 * np.max(P))


def test_steps_ahead_at_once_equal_single_steps() -> None:
    model = augment(dynamic_model(1), horizon=20)
    rng = np.random.default_rng(7)
    one, many = initial_belief(model), initial_belief(model)
    one.x = many.x = rng.normal(size=len(model.F))
    predict_ahead(one, model, 13)
    for _ in range(13):
        predict(many, model, None, ahead=True)
    assert one.x == pytest.approx(many.x, rel=1e-12)
    assert np.allclose(one.P, many.P, rtol=1e-10)


@pytest.mark.parametrize("damping", [0.7, 0.9, 1.0])
def test_forecast_growth_gives_the_velocity_noise_back(damping: float) -> None:
    growth = growth_m(damping, 3e-4, 40)
    noise, variance = input_noise(InputForecast(damping, 1, growth[:15]), 40)
    assert np.sqrt(noise) == pytest.approx(np.full(3, 3e-4), rel=1e-9)
    assert np.sqrt(variance[1:]) == pytest.approx(growth, rel=1e-9)
    assert np.all(variance[0] == 0.0)


def test_a_hand_that_comes_back_later_is_no_surer_soon() -> None:
    growth = growth_m(0.9, 3e-4, 40)
    saturated = np.minimum(growth, growth[8])
    noise, _ = input_noise(InputForecast(0.9, 1, saturated, 0.98), 40)
    assert np.sqrt(noise) == pytest.approx(np.full(3, 3e-4), rel=1e-9)


def test_forecast_mean_follows_the_damped_velocity() -> None:
    model = augment(static_model(damping=0.5), horizon=10)
    belief = initial_belief(model)
    set_command(belief, model, np.array([1.0, 2.0, 3.0]), 0, np.array([1.0, 0.0, -1.0]))
    for _ in range(3):
        predict(belief, model, None, ahead=True)
    assert belief.x[model.command] == pytest.approx([1.875, 2.0, 2.125])


def test_forecast_mean_comes_back_and_its_errors_stay_those_of_the_velocity() -> None:
    arm = static_model(damping=0.5)
    there = augment(arm, horizon=10)
    back = augment(replace(arm, forecast=replace(arm.forecast, persistence=0.8)), horizon=10)
    filters = [initial_belief(model) for model in (there, back)]
    for belief, model in zip(filters, (there, back), strict=True):
        set_command(belief, model, np.array([1.0, 2.0, 3.0]), 0, np.array([1.0, 0.0, -1.0]))
        predict_ahead(belief, model, 3)
    way = 0.5**3 + 0.5**2 * 0.8 + 0.5 * 0.8**2
    assert filters[1].x[back.command] == pytest.approx([1 + way, 2.0, 3 - way])
    assert np.array_equal(filters[0].P, filters[1].P)


def test_unknown_command_enters_the_output_through_d() -> None:
    model = augment(static_model(gain=0.5), horizon=10)
    belief = initial_belief(model)
    set_command(belief, model, np.zeros(3), 4, np.zeros(3))
    belief.P[model.bias, model.bias] = 0.0
    assert np.sqrt(np.diag(model.H @ belief.P @ model.H.T)) == pytest.approx(0.5 * growth_m(0.9, 1e-4, 4)[3])


def test_start_is_where_a_constant_command_leads() -> None:
    arm = dynamic_model(2)
    model, u = augment(arm, horizon=10), np.array([0.1, -0.2, 0.3])
    belief = initial_belief(model)
    start_at(belief, model, u, 0)
    settled = arm.space.simulate(np.tile(u, (500, 1)))[-1]
    assert model.H @ belief.x == pytest.approx(settled, rel=1e-9)


def test_noise_model_is_made_consistent() -> None:
    rng = np.random.default_rng(3)
    Q, R = 1e4 * np.eye(2), np.diag([1e-10, 1e-10, 0.0])  # a third output without noise, states in other units
    S = 5.0 * np.sqrt(1e4 * 1e-10) * np.ones((2, 3))  # more than fully correlated
    model = augment(arm_model(random_space(rng, 2), NoiseModel(Q, R, S)), horizon=10)
    joint = np.block([[model.Q[:2, :2], model.S[:2]], [model.S[:2].T, model.R]])
    scale = np.sqrt(np.diag(joint))
    assert np.linalg.eigvalsh(joint / np.outer(scale, scale)).min() > -1e-12
    assert np.linalg.eigvalsh(model.R).min() >= 0.999 * NOISE_FLOOR_M**2


@given(st.integers(0, 4), st.integers(0, 1000), st.lists(st.tuples(st.booleans(), st.booleans()), max_size=30))
@settings(max_examples=40, deadline=None)
def test_covariances_stay_positive_semi_definite(n: int, seed: int, course: list[tuple[bool, bool]]) -> None:
    rng = np.random.default_rng(seed)
    model = augment(arm_model(random_space(rng, n), random_noise(rng, n, 1e-3, 1e-4)), horizon=10)
    belief, output = initial_belief(model), None
    for known, measured in course:
        predict(belief, model, output, ahead=not known)
        if known:
            set_command(belief, model, rng.normal(size=3), 0, np.zeros(3))
        output = rng.normal(size=3) if measured else None
        if output is not None:
            update(belief, model, output)
        spread = np.sqrt(np.maximum(np.diag(belief.P), 1e-30))
        assert np.linalg.eigvalsh((belief.P + belief.P.T) / np.outer(spread, spread)).min() > -1e-6
