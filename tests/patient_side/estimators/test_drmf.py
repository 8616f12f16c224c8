from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

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
from tests.patient_side.identification.known_systems import real_recording
from tis.common.errors import DataError
from tis.common.units import sample_instant_ns
from tis.patient_side.estimators.drmf import Drmf, drmf
from tis.patient_side.estimators.simple import Hold
from tis.patient_side.identification import fit_drmf as fitting
from tis.patient_side.identification.fit_drmf import fit_drmf
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import CompletionModel, Factorisation
from tis.patient_side.playout import Playout

COVARIANCES = np.array([1e-6, 9e-6, 16e-6])[:, None, None] * np.eye(3)


def exact_model(stride: int = 1) -> CompletionModel:
    """Rank 4 and no ridge: a sum of two sinusoids is completed exactly, up to ten steps."""
    numbers = Factorisation(4, 0.0, 1, 1e-4, 1e-24, 1e-10, 100)
    return CompletionModel(stride, 40, np.zeros(20), 0.0, numbers, 10, np.array([1, 4, 10]), COVARIANCES)


def sinusoids(n_rows: int, stride: int = 1) -> Array:
    t = np.arange(n_rows)[:, None] / stride
    return np.asarray(0.01 * np.sin(0.3 * t + [0.0, 1.0, 2.0]) + 0.004 * np.cos(0.8 * t + [0.5, 0.0, 1.0]) + 0.1)


def playout_of(y: Array, indices: list[int], rate_hz: int = RATE_HZ) -> Playout:
    playout = Playout(rate_hz)
    for index in indices:
        playout.arm.add(index, y[index])
    return playout


def at(model: CompletionModel, playout: Playout, index: int, steps: float) -> tuple[Array, Array]:
    now_ns = sample_instant_ns(index, playout.rate_hz) + round(steps * model.stride * 1e9 / playout.rate_hz)
    _, estimate = Drmf(model).step(None, playout, now_ns)
    assert estimate.position_m is not None
    assert estimate.covariance_m2 is not None
    return estimate.position_m, estimate.covariance_m2


@pytest.mark.parametrize("steps", [1, 2, 7, 10])
def test_a_sum_of_sinusoids_is_continued_through_gaps(steps: int) -> None:
    y = sinusoids(130)
    there = [i for i in range(111) if i % 4 and i not in (101, 102, 103)]
    found, _ = at(exact_model(), playout_of(y, there), there[-1], steps)
    assert found == pytest.approx(y[there[-1] + steps], abs=1e-6)


def test_a_struck_sample_is_left_out() -> None:
    y = sinusoids(130)
    struck = y.copy()
    struck[95] += [0.01, -0.02, 0.005]
    for steps in (1, 5):
        found, _ = at(exact_model(), playout_of(struck, list(range(111))), 110, steps)
        assert found == pytest.approx(y[110 + steps], abs=1e-6)


def test_at_a_higher_rate_a_step_is_several_samples() -> None:
    y = sinusoids(1200, stride=8)
    model, all_of_them = exact_model(stride=8), list(range(1000))
    assert at(model, playout_of(y, all_of_them, 240), 999, 3)[0] == pytest.approx(y[999 + 24], abs=1e-6)
    # Between two neighbours that have arrived a sample is interpolated.
    without = [i for i in all_of_them if i % 8 != 6 or i == 999]
    assert at(model, playout_of(y, without, 240), 999, 3)[0] == pytest.approx(y[999 + 24], abs=2e-3)


def test_between_steps_it_interpolates_and_beyond_the_last_horizon_it_stays() -> None:
    y = sinusoids(130)
    model, playout = exact_model(), playout_of(y, list(range(111)))
    for below, share in ((0, 0.5), (3, 0.25), (9, 0.9)):
        wanted = (1 - share) * y[110 + below] + share * y[111 + below]
        assert at(model, playout, 110, below + share)[0] == pytest.approx(wanted, abs=1e-6)
    assert at(model, playout, 110, 300.0)[0] == pytest.approx(at(model, playout, 110, 10.0)[0])
    for steps, variance in (
        (0.0, 0.0),
        (0.5, 0.25e-6),
        (1.0, 1e-6),
        (2.0, 3.6666667e-6),
        (10.0, 16e-6),
        (30.0, 48e-6),
    ):
        assert at(model, playout, 110, steps)[1] == pytest.approx(variance * np.eye(3), abs=1e-11)


def test_without_a_sample_there_is_no_estimate_and_one_alone_is_held() -> None:
    y = sinusoids(20)
    estimator = Drmf(exact_model())
    assert estimator.step(None, Playout(RATE_HZ), 0)[1].position_m is None
    found, _ = at(exact_model(), playout_of(y, [5]), 5, 3)
    assert found == pytest.approx(y[5], abs=1e-9)


@given(
    arrivals=st.lists(st.integers(0, 5000), min_size=1, max_size=60),
    size=st.sampled_from([0.0, 1e-12, 1e-3, 1e4]),
    steps=st.floats(-3, 1e4),
    seed=st.integers(0, 1000),
)
@settings(max_examples=60, deadline=None)
def test_on_any_arrivals_estimates_are_finite(arrivals: list[int], size: float, steps: float, seed: int) -> None:
    y = size * np.random.default_rng(seed).normal(size=(5001, 3))
    playout = playout_of(y, arrivals)
    for model in (exact_model(), exact_model(stride=8)):
        position, covariance = at(model, playout, max(arrivals), steps)
        assert np.isfinite(position).all()
        assert np.isfinite(covariance).all()
        assert np.linalg.eigvalsh(covariance)[0] >= 0


def test_a_model_file_without_its_model_is_named() -> None:
    with pytest.raises(DataError, match="drmf needs a model of the arm's movement"):
        drmf(replace(static_model(), drmf=None))


@pytest.mark.slow
def test_on_a_real_trial_it_beats_hold(jigsaws_dir: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    y = real_recording(jigsaws_dir, "Suturing_D002").hands[0].follower.position_m
    monkeypatch.setattr(fitting, "_N_CALIBRATED", 30)  # covariances, which are not looked at
    estimator = Drmf(fit_drmf([y[:1240]], RATE_HZ))
    y = y[1240:2240]
    for delay_ms, bound in ((33, 0.55), (100, 0.55), (200, 0.65)):
        streams = Streams(y, y, [LOST] * len(y), delayed(len(y), delay_ms * 1_000_000))
        found, hold = positions(play(estimator, streams)), positions(play(Hold(), streams))
        scored = slice(70, -1)
        assert ratio_to_hold(found[scored], hold[scored], truth_at_ticks(y)[scored]) < bound
