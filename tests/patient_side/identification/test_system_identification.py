"""`from tis import identify`: known systems, free poles, units, gaps, delays and faults."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_discrete_are

from tests.patient_side.identification.known_systems import Array, Noisy, four_states, markov
from tis import identify
from tis.common.errors import DataError
from tis.deploy.bench.prediction_accuracy import PLANTS, Plant, prediction_errors
from tis.patient_side.identification.noise import riccati_gain
from tis.patient_side.linear_system import StateSpace

SHARED = Path(__file__).resolve().parents[4] / "shared" / "data"
BALL = PLANTS[0]


def noisy(n_rows: int, seed: int = 3) -> tuple[Array, Array]:
    space = four_states()
    return Noisy(space, 0.02 * np.eye(4), 0.05 * np.eye(3)).run(n_rows, np.random.default_rng(seed))


@pytest.mark.parametrize("method", ["moesp", "pi_moesp", "n4sid", "cva"])
def test_without_noise_the_markov_parameters_are_those_of_the_system(method: str) -> None:
    space = four_states()
    u = np.random.default_rng(0).normal(size=(600, 2))
    system = identify(u, space.simulate(u), order=4, horizon=8, method=method)
    assert np.allclose(markov(system.space, 20), markov(space, 20), atol=1e-6)


def optimal_error(plant: Plant, u: Array, y: Array) -> float:
    """Return the rms error, 5 samples ahead, of the filter that knows the plant."""
    A, B, C = plant.space.A, plant.space.B, plant.space.C
    Q, R = np.diag(np.square(plant.w)), np.array([[plant.v**2]])
    P = solve_discrete_are(A.T, C.T, Q, R)
    K = A @ P @ C.T / (C @ P @ C.T + R)
    x, errors = np.zeros(2), []
    for k in range(len(u) - 5):
        x = A @ x + B @ u[k] + K @ (y[k] - C @ x)
        ahead = x
        for step in range(1, 5):
            ahead = A @ ahead + B @ u[k + step]
        errors.append((y[k + 5] - C @ ahead)[0])
    return float(np.sqrt(np.mean(np.square(errors[1080:]))))


@pytest.mark.parametrize("plant", PLANTS, ids=[plant.name for plant in PLANTS])
def test_poles_at_the_unit_circle_are_kept_and_predict_as_the_known_plant_does(plant: Plant) -> None:
    u, y = plant.rows(1500, 1)
    system = identify(u[:1050], y[:1050], horizon=15)
    error = float(np.sqrt(np.mean(np.square((y - system.predict(u, y, steps=5))[1085:]))))
    assert error <= 1.1 * optimal_error(plant, u, y)
    assert np.allclose(np.max(np.abs(system.poles)), plant.space.spectral_radius(), atol=0.02)


def test_stable_moves_the_poles_inside() -> None:
    u, y = BALL.rows(1000, 1)
    assert np.max(np.abs(identify(u, y, order=2, stable=True).poles)) < 1
    kept = identify(u, y, order=2)
    assert ("unit circle" in "".join(kept.warnings)) == (np.max(np.abs(kept.poles)) >= 1)


@pytest.mark.parametrize("file", ["slicot/IB01AD.dat", "evaporator/evaporator.dat"])
def test_published_data_are_predicted_as_by_other_packages(file: str) -> None:
    if not (SHARED / file).exists():
        pytest.skip(f"no {file} in ../shared/data beside the checkout")
    if "slicot" in file:
        values = np.array((SHARED / file).read_text().split("\n", 2)[2].split()[:2000], dtype=float)
        u, y, best = values[:1000, None], values[1000:, None], 0.0847  # SLICOT
    else:
        columns = np.loadtxt(SHARED / file)
        u, y, best = columns[:, :3], columns[:, 3:6], 0.3508  # SLICOT
    u, y = u - u[: len(u) * 7 // 10].mean(axis=0), y - y[: len(y) * 7 // 10].mean(axis=0)
    errors = dict(prediction_errors(u, y, 4))
    assert errors["tis moesp"] <= 1.05 * best


@settings(max_examples=4, deadline=None)
@given(st.sampled_from([2.0**-30, 2.0**30, 1e-9, 1e9]), st.sampled_from([2.0**-30, 2.0**30, 1e-9, 1e9]))
def test_units_change_nothing(of_input: float, of_output: float) -> None:
    u, y = noisy(400)
    here, there = identify(u, y, horizon=4), identify(u * of_input, y * of_output, horizon=4)
    binary = {of_input, of_output} <= {2.0**-30, 2.0**30}
    tolerance = 1e-9 if binary else 1e-6
    assert there.order == here.order
    assert np.allclose(there.K * of_output, here.K, rtol=tolerance, atol=tolerance)
    scaled = markov(there.space, 10) * of_input / of_output
    assert np.allclose(scaled, markov(here.space, 10), rtol=tolerance, atol=tolerance)
    ahead = there.forecast(u * of_input, y * of_output, 5)[0] / of_output
    assert np.allclose(ahead, here.forecast(u, y, 5)[0], rtol=tolerance, atol=tolerance)


def test_gaps_end_stretches_and_the_filter_passes_them() -> None:
    u, y = noisy(1200)
    y[300:310], y[700, 1], u[900, 0] = np.nan, np.nan, np.nan
    system = identify(u, y, order=4, horizon=6)
    assert system.stretches == ((0, 0, 300), (0, 310, 700), (0, 701, 900), (0, 901, 1200))
    assert len(system.linear.x0) == 4
    assert np.allclose(markov(system.space, 8), markov(four_states(), 8), atol=0.1)
    assert np.isfinite(system.predict(u, y, steps=3)[3:]).all()


def test_the_order_is_the_best_one_also_where_every_error_is_far_below_that_of_hold() -> None:
    servo = PLANTS[1]
    u, y = servo.rows(1500, 2)
    orders = identify(u, y).orders
    assert orders is not None
    assert orders.predictions[orders.validation] <= 1.05 * min(orders.predictions)
    assert min(orders.predictions) < 0.05


@pytest.mark.parametrize("stable", [False, True])
def test_a_random_walk_without_inputs_has_one_pole_at_one(stable: bool) -> None:
    walk = np.cumsum(np.random.default_rng(3).normal(size=600))
    (pole,) = identify(None, walk, order=1, stable=stable).poles
    assert pole == pytest.approx(1.0, abs=0.02)
    with pytest.raises(DataError, match="pi_moesp"):
        identify(None, walk, method="pi_moesp")


def test_outputs_alone_are_identified_too() -> None:
    _, y = Noisy(four_states(), 0.5 * np.eye(4), 0.05 * np.eye(3)).run(3000, np.random.default_rng(5))
    alone = identify(None, y)
    assert alone.B.shape == (alone.order, 0)
    mean, covariance = alone.forecast(None, y, 3)
    assert mean.shape == (3, 3)
    assert np.linalg.eigvalsh(covariance[2])[0] > 0


def test_an_input_delay_is_found_and_kept() -> None:
    space = four_states()
    rng = np.random.default_rng(8)
    u = rng.normal(size=(1500, 2))
    late = np.column_stack([np.concatenate([np.zeros(4), u[:-4, 0]]), u[:, 1]])
    y = space.simulate(late) + 0.02 * rng.normal(size=(1500, 3))
    # D acts at once: the delay found is one less, as a strictly proper system has one sample of its own.
    assert identify(u, y, order=4, delay="auto").delay == (3, 0)
    system = identify(u, y, order=4, delay=(4, 0))
    assert np.allclose(markov(system.space, 8), markov(space, 8), atol=0.05)
    assert float(np.std((y - system.predict(u, y, steps=1))[50:])) < 0.025
    assert float(np.std((y - system.simulate(u))[50:])) < 0.025


def test_the_continuous_system_is_exact_between_samples_or_refused() -> None:
    u, y = BALL.rows(1500, 1)
    found = identify(u, y, dt=0.1, order=2).continuous()
    assert np.allclose(np.linalg.eigvals(found.A), 0, atol=0.2)
    with pytest.raises(DataError, match="continuous: poles"):
        identify(*noisy(1500), order=4).continuous()  # one pole at -0.5


def test_all_faults_of_the_arguments_are_named_at_once() -> None:
    with pytest.raises(DataError) as raised:
        identify(np.zeros((9, 1)), np.zeros((9, 1)), dt=-1, method="x", order="y", horizon=0, delay=-1)  # type: ignore[arg-type]
    assert [fault.field for fault in raised.value.faults] == ["dt", "method", "order", "horizon", "delay"]
    with pytest.raises(DataError, match="as many rows"):
        identify(np.zeros((9, 1)), np.zeros((8, 1)))
    with pytest.raises(DataError, match="constant"):
        identify(np.zeros((99, 1)), np.zeros((99, 1)))


def test_riccati_gain_is_that_of_the_known_system() -> None:
    space, rng = four_states(), np.random.default_rng(4)
    errors = rng.normal(size=(100_000, 7)) * np.array([0.3] * 4 + [0.5] * 3)
    P = np.eye(4)
    for _ in range(500):  # the Riccati recursion
        K = space.A @ P @ space.C.T @ np.linalg.inv(space.C @ P @ space.C.T + 0.25 * np.eye(3))
        P = space.A @ P @ space.A.T + 0.09 * np.eye(4) - K @ (space.C @ P @ space.C.T + 0.25 * np.eye(3)) @ K.T
    assert np.allclose(riccati_gain(space.A, space.C, errors), K, atol=0.02)
    integrator = StateSpace(np.eye(1), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1)))
    assert 0 < riccati_gain(integrator.A, integrator.C, np.zeros((5, 2)))[0, 0] < 2


def test_it_loads_neither_the_testbed_nor_its_libraries() -> None:
    code = "import sys; from tis import identify; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert {"pydantic", "zenoh", "yaml", "filterpy", "scipy.signal", "scipy.stats"}.isdisjoint(loaded)
    assert not [name for name in loaded if name.startswith("tis.common.scenario")]
