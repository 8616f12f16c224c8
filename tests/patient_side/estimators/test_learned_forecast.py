from dataclasses import replace

import numpy as np
import pytest

from tests.patient_side.arm_models import RATE_HZ, static_model
from tests.patient_side.learned.models import LEARNED, learned_model
from tests.patient_side.learning.tracks import turning
from tis.common.errors import DataError
from tis.common.scenario.estimator_names import LearnedName
from tis.common.units import sample_instant_ns
from tis.patient_side.estimators.learned_forecast import LearnedForecast, learned_forecast, linear_forecast
from tis.patient_side.learned.inputs import activity_of, window_of_rows
from tis.patient_side.learned.predictor import predictor_of
from tis.patient_side.playout import Playout
from tis.patient_side.statespace import ArmModel

N = 120
EACH = pytest.mark.parametrize("method", LEARNED)


def without_gain() -> ArmModel:
    return replace(static_model(), static=False)


def played(model: ArmModel, lost: int = 7) -> tuple[Playout, np.ndarray[tuple[int], np.dtype[np.float64]]]:
    """The arm's samples, of which every seventh is lost, and the instants at which they arrived."""
    track, playout = turning(1, N), Playout(model.rate_hz)
    arrival = np.where(np.arange(N) % lost == 3, np.inf, np.arange(float(N)))
    for i in range(N):
        if np.isfinite(arrival[i]):
            playout.arm.add(i, track.position_m[i], float(track.gripper_rad[i]))
    return playout, arrival


@EACH
def test_an_estimate_is_the_linear_forecast_and_what_it_leaves(method: LearnedName) -> None:
    model = without_gain()
    playout, arrival = played(model)
    estimator = learned_forecast(method, model)
    now_ns = sample_instant_ns(N + 4, RATE_HZ)
    state, found = estimator.step(estimator.initial(), playout, now_ns)
    # The same from rows, as training sees them.
    linear = linear_forecast(model)
    _, forecast = linear.step(linear.initial(), playout, now_ns)
    assert forecast.position_m is not None
    assert forecast.covariance_m2 is not None
    newest, learned, track = playout.arm.newest, learned_model(method), turning(1, N)
    window = window_of_rows(track.position_m, track.gripper_rad, arrival, np.array([newest]), np.array([float(N)]))
    activity = activity_of(window, learned.usual_m)
    scale = float(activity[0]) / np.sqrt(state.ring[-1].activity[0])
    unit_m = scale * np.sqrt(np.trace(forecast.covariance_m2) / 3)
    move = (forecast.position_m - track.position_m[newest]) / unit_m
    left = predictor_of(learned)(window, activity, playout.age_samples(newest, now_ns), move)
    assert found.position_m is not None
    assert found.covariance_m2 is not None
    np.testing.assert_allclose(found.position_m, forecast.position_m + unit_m * left.mean, rtol=1e-9)
    factor = (scale * np.exp(left.log_deviation)) ** 2 * left.covariance_scale
    np.testing.assert_allclose(found.covariance_m2, factor * forecast.covariance_m2, rtol=1e-9)
    assert not np.allclose(found.position_m, forecast.position_m)


def test_commands_stand_in_for_lost_samples_where_a_gain_is_all() -> None:
    model = static_model()
    (playout, _), whole = played(model), Playout(RATE_HZ)
    track = turning(1, N)
    for i in range(N):
        playout.command.add(i, 2.0 * track.position_m[i])
        whole.arm.add(i, track.position_m[i], float(track.gripper_rad[i]))
        whole.command.add(i, 2.0 * track.position_m[i])
    estimator, now_ns = learned_forecast("cnn", model), sample_instant_ns(N + 4, RATE_HZ)
    ours, full = (estimator.step(estimator.initial(), each, now_ns)[1].position_m for each in (playout, whole))
    assert ours is not None
    assert full is not None
    # Grippers of lost samples stay unknown, positions do not.
    assert np.linalg.norm(ours - full) < 0.2 * np.linalg.norm(full - track.position_m[-1])


@EACH
def test_at_the_newest_sample_nothing_is_added_and_before_the_first_there_is_nothing(method: LearnedName) -> None:
    model = without_gain()
    estimator = learned_forecast(method, model)
    assert estimator.step(estimator.initial(), Playout(RATE_HZ), 0)[1].position_m is None
    playout, _ = played(model)
    newest = playout.arm.newest
    _, found = estimator.step(estimator.initial(), playout, sample_instant_ns(newest, RATE_HZ))
    _, linear = linear_forecast(model).step(estimator.initial(), playout, sample_instant_ns(newest, RATE_HZ))
    assert np.array_equal(found.position_m, linear.position_m)  # type: ignore[arg-type]


def test_a_file_without_the_model_is_refused_with_the_command() -> None:
    with pytest.raises(DataError, match="the model holds none for transformer: train one with `tis identify --set"):
        learned_forecast("transformer", replace(static_model(), learned=()))
    with pytest.raises(DataError, match="learned methods need the innovations form"):
        learned_forecast("cnn", replace(static_model(), innovations=None))


def test_beyond_five_seconds_what_is_added_stays() -> None:
    model = without_gain()
    playout, _ = played(model)
    estimator: LearnedForecast = learned_forecast("cnn", model)
    newest = playout.arm.newest
    found = [
        estimator.step(estimator.initial(), playout, sample_instant_ns(newest + age, RATE_HZ))[1].position_m
        for age in (151, 400)
    ]
    np.testing.assert_allclose(found[0], found[1], atol=1e-6)  # type: ignore[arg-type]
