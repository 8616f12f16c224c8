"""Inputs held for many samples, as a slow recorder's are: every method gives a model, or a fault in words."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from tis.common.errors import DataError, Fault
from tis.common.scenario.identification import Identification
from tis.common.sources.trajectory import HandRecording, PoseTrack, Recording
from tis.patient_side.identification import stochastic_moesp
from tis.patient_side.identification.companions import fit_companions
from tis.patient_side.identification.dataset import training_set
from tis.patient_side.identification.identify import identify_with_orders
from tis.patient_side.identification.subspace_methods import METHODS
from tis.patient_side.identification.trials import breakdown_as_fault, explain_repeats
from tis.patient_side.linear_system import Array

_KERNELS = {**METHODS, "stochastic_moesp": stochastic_moesp.identify}
_N = 400


def _staircase(seed: int, step: int, uneven: int) -> Array:
    """Return a random walk (400, 3), in m, held for ``step`` samples, give or take ``uneven``."""
    draw = np.random.default_rng(seed)
    walk = np.cumsum(draw.standard_normal((_N, 3)), axis=0) * 1e-3
    begins, at = np.empty(_N, dtype=int), 0
    while at < _N:
        length = max(1, step + int(draw.integers(-uneven, uneven + 1)))
        begins[at : at + length] = at
        at += length
    return walk[begins]


def _followed(u: Array, arm: str, noise_m: float, seed: int) -> Array:
    y = {"same": u, "gain": 0.5 * u[:, ::-1], "lag": lfilter([0.1], [1.0, -0.9], u, axis=0)}[arm]
    return np.asarray(y + noise_m * np.random.default_rng(seed + 1).standard_normal(u.shape))


def _recording(u: Array, y: Array) -> Recording:
    def track(positions: Array) -> PoseTrack:
        return PoseTrack(positions, np.tile([0.0, 0.0, 0.0, 1.0], (_N, 1)), np.zeros(_N))

    return Recording("staircase", 1000, (HandRecording("left", "PSM2", track(u), track(y)),), 0, "none")


_STEPS = st.one_of(st.integers(1, 60), st.sampled_from([100, 300]))
_ARMS = st.sampled_from(["same", "gain", "lag"])
_NOISES_M = st.sampled_from([0.0, 0.0, 1e-12, 1e-9, 1e-6, 1e-4])


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**16), _STEPS, st.integers(0, 3), _ARMS, _NOISES_M, st.sampled_from(sorted(_KERNELS)))
def test_a_method_gives_a_finite_stable_model_or_a_fault(
    seed: int, step: int, uneven: int, arm: str, noise_m: float, method: str
) -> None:
    u = _staircase(seed, step, uneven)
    y = _followed(u, arm, noise_m, seed)
    try:
        found = _KERNELS[method](u, y, 3, 5)
    except DataError:
        return
    assert found.space.spectral_radius() < 1
    for matrix in (found.space.A, found.space.B, found.space.C, found.space.D, found.noise.Q, found.noise.R):
        assert np.all(np.isfinite(matrix))


@settings(max_examples=12, deadline=None)
@given(
    st.integers(0, 2**16),
    _STEPS,
    st.integers(0, 3),
    _ARMS,
    _NOISES_M,
    st.sampled_from(["moesp", "pi_moesp", "n4sid", "cva", "arx", "moesp_paper"]),
    st.sampled_from([2, 5]),
)
def test_a_run_s_model_is_finite_or_a_fault(
    seed: int, step: int, uneven: int, arm: str, noise_m: float, method: str, block_rows: int
) -> None:
    u = _staircase(seed, step, uneven)
    identification = Identification.model_validate({"method": method, "block_rows": block_rows})
    try:
        found = identify_with_orders(
            [_recording(u, _followed(u, arm, noise_m, seed))], "left", identification, "none"
        )
    except DataError:
        return
    assert np.all(np.isfinite(found.model.space.A))
    assert np.all(np.isfinite(found.model.noise.R))


@pytest.mark.parametrize("step", [20, 50])
def test_a_movement_that_tells_nothing_of_what_follows_has_an_innovations_model(step: int) -> None:
    # Increments a window apart: what past and future explain of each other is 0 to the last bit.
    u = _staircase(3, step, 0)
    training = training_set([_recording(u, 0.5 * u)], "left", pool_hands=False)
    found = fit_companions(training, Identification(block_rows=5), ["innovations_kf"]).models["innovations"]
    assert found is not None
    assert np.all(np.isfinite(found.K))
    assert np.all(np.linalg.eigvalsh(found.Re) > 0)


def test_the_default_method_has_a_model_of_a_recorder_slower_than_the_loop() -> None:
    # A fixed staircase of 19 or 20 samples a step on which every method but arx once broke down.
    u = _staircase(7, 19, 1)
    for method in ("moesp", "n4sid", "cva", "arx"):
        identification = Identification.model_validate({"method": method})
        found = identify_with_orders([_recording(u, _followed(u, "gain", 0.0, 7))], "left", identification, "none")
        assert found.model.static
        assert pytest.approx(found.model.space.D, abs=1e-6) == 0.5 * np.eye(3)[::-1]


def test_a_single_step_has_an_arx_model() -> None:
    # The lagged inputs are all alike; with every digit trusted, coefficients were 1e9 and their poles noise.
    draw = np.random.default_rng(4)
    u = np.repeat(draw.standard_normal((_N, 3))[[0, 300]] * 0.01, [300, 100], axis=0)
    y = np.asarray(lfilter([0.1], [1.0, -0.9], u, axis=0))
    identification = Identification(method="arx", order="criterion")
    model = identify_with_orders([_recording(u, y)], "left", identification, "none").model
    assert np.max(np.abs(model.space.A)) < 1e3
    assert model.spectral_radius < 1


def test_what_linear_algebra_gives_up_on_is_a_fault_that_says_what_to_do() -> None:
    wanted = r"n4sid breaks down on them .*Singular.*fewer block rows or more rows"
    with pytest.raises(DataError, match=wanted), breakdown_as_fault("n4sid"):
        np.linalg.inv(np.zeros((2, 2)))


def test_rows_that_repeat_are_named_as_a_reason_and_others_are_not() -> None:
    rows = np.random.default_rng(1).standard_normal((60, 3))
    fault = Fault("identification", "input", "must be persistently exciting")
    with pytest.raises(DataError) as caught, explain_repeats([np.repeat(rows, 5, axis=0)]):
        raise DataError(fault)
    told = [str(one) for one in caught.value.faults]
    assert told[0] == str(fault)
    assert told[1].startswith("identification: training rows: 80% of them repeat the row before")
    assert told[1].endswith("source.recorder_hz=null")
    with pytest.raises(DataError) as caught, explain_repeats([rows]):
        raise DataError(fault)
    assert [str(one) for one in caught.value.faults] == [str(fault)]
