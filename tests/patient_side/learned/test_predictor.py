from dataclasses import replace

import numpy as np
import pytest

from tests.patient_side.learned.models import LEARNED, learned_model
from tests.patient_side.learned.test_inputs import window
from tis.common.errors import DataError
from tis.common.scenario.estimator_names import LearnedName
from tis.patient_side.learned.gaussian_head import distribution
from tis.patient_side.learned.inputs import age_inputs
from tis.patient_side.learned.networks import NETWORKS
from tis.patient_side.learned.predictor import check_model, predictor_of

EACH = pytest.mark.parametrize("method", LEARNED)
ONE = window(4)._replace(
    way_m=window(4).way_m[:1], gripper_rad=window(4).gripper_rad[:1], present=window(4).present[:1]
)


def faults(model_change: dict[str, object], method: LearnedName = "cnn") -> list[str]:
    with pytest.raises(DataError) as caught:
        check_model(replace(learned_model(method), **model_change))  # type: ignore[arg-type]
    return [str(fault) for fault in caught.value.faults]


@EACH
def test_a_prediction_is_finite_repeats_and_has_a_calibrated_scale(method: LearnedName) -> None:
    predictor = predictor_of(learned_model(method))
    first, again = (predictor(ONE, np.ones(1), 6.0, np.zeros(3)) for _ in range(2))
    assert np.isfinite(first.mean).all()
    assert np.array_equal(first.mean, again.mean)
    assert first.log_deviation == again.log_deviation
    assert first.covariance_scale == pytest.approx(1.5)
    assert predictor(ONE, np.ones(1), 0.1, np.zeros(3)).covariance_scale == pytest.approx(1.2)
    present = ONE.present.copy()
    present[0, 5] = False
    assert predictor(ONE._replace(present=present), np.ones(1), 6.0, np.zeros(3)).covariance_scale == 2.5


@EACH
def test_a_model_of_another_version_is_refused_by_name(method: LearnedName) -> None:
    (fault,) = faults({"version": 0}, method)
    assert fault.startswith(f"model: learned.{method}.version: must be version 1; train it again with `tis identify")


def test_a_model_for_other_inputs_is_refused_with_all_arrays_that_differ() -> None:
    weights = dict(learned_model("cnn").weights)
    weights["context.weight"] = np.zeros((7, 16), dtype=np.float32)
    del weights["summary.bias"]
    weights["extra"] = np.zeros(3, dtype=np.float32)
    assert faults({"weights": weights}) == [
        "model: learned.cnn.context.weight: must be an array (52, 16) (got (7, 16))",
        "model: learned.cnn.extra: is no array of this method (got (3,))",
        "model: learned.cnn.summary.bias: is missing: must be an array (48,)",
    ]


def test_a_process_of_other_features_or_without_points_is_refused() -> None:
    weights = dict(learned_model("gpr").weights)
    (fault,) = faults({"weights": {**weights, "points": np.zeros((5, 7), dtype=np.float32)}}, "gpr")
    rule = "must be an array (points, 48), one column for each input"
    assert fault == f"model: learned.gpr.points: {rule} (got (5, 7))"
    del weights["points"]
    assert faults({"weights": weights}, "gpr")[0].startswith("model: learned.gpr.points: is missing: must be")


def test_weights_that_are_not_finite_are_refused() -> None:
    weights = dict(learned_model("cnn").weights)
    weights["summary.bias"] = np.full(48, np.nan, dtype=np.float32)
    assert faults({"weights": weights}) == ["model: learned.cnn.summary.bias: must be finite"]


@pytest.mark.parametrize("name", ["transformer", "informer", "cnn"])
def test_numpy_and_jax_compute_the_same(name: LearnedName) -> None:
    jnp = pytest.importorskip("jax.numpy", reason="needs the extra learned")
    rng = np.random.default_rng(0)
    network, weights = NETWORKS[name], learned_model(name).weights
    steps, context = rng.normal(size=(4, 64, 8)).astype(np.float32), rng.normal(size=(4, 52)).astype(np.float32)
    ages, moves = age_inputs(rng.uniform(0.1, 150, (4, 3))), rng.normal(size=(4, 3, 3)).astype(np.float32)
    in_numpy = network(np, weights, steps, context, ages, moves)
    in_jax = network(jnp, {key: jnp.asarray(each) for key, each in weights.items()}, steps, context, ages, moves)
    for ours, theirs in zip(in_numpy, in_jax, strict=True):
        assert ours.dtype == np.float32
        np.testing.assert_allclose(ours, np.asarray(theirs), rtol=2e-4, atol=2e-5)


def test_the_logarithm_of_a_deviation_is_bounded() -> None:
    weights = {name: 50.0 * each for name, each in learned_model("cnn").weights.items()}
    _, log_deviation = distribution(np, weights, np.ones((1, 48)), np.ones((1, 2, 7)), np.ones((1, 2, 3)))
    assert np.all((log_deviation >= -4.0) & (log_deviation <= 3.0))
