"""Estimators that are another one's filter on a model of their own: `n4sid_kf` and `arx_kf`."""

from dataclasses import replace

import numpy as np
import pytest

from tests.patient_side.arm_models import (
    Streams,
    arm_model,
    at_operating_point,
    delayed,
    play,
    positions,
    random_command,
    random_noise,
    random_space,
    simulate,
    slow_movement,
    static_model,
)
from tis.common.errors import DataError
from tis.patient_side.estimators.innovations_kf import InnovationsKf
from tis.patient_side.estimators.moesp_kf import MoespKf, arx_kf, n4sid_kf
from tis.patient_side.estimators.protocol import Estimator
from tis.patient_side.linear_system import Array
from tis.patient_side.statespace import ArmModel, FilterModel


def some_model(seed: int, n: int) -> ArmModel:
    rng = np.random.default_rng(seed)
    model = arm_model(random_space(rng, n), random_noise(rng, n, 1e-4, 1e-5))
    return at_operating_point(model, [0.1, 0.2, 0.3], [-0.1, 0.0, 0.1])


def beside(model: ArmModel) -> FilterModel:
    return FilterModel(model.space, model.noise, model.input_offset_m, model.output_offset_m, model.static)


def answers(estimator: Estimator) -> Array:
    rng = np.random.default_rng(3)
    u = 0.1 + random_command(rng, 60, 0.9, 1e-4)
    streams = Streams(u, simulate(some_model(1, 2), u, rng), delayed(60, 30_000_000), delayed(60, 90_000_000))
    return positions(play(estimator, streams))


def test_each_is_the_filter_of_moesp_kf_on_its_own_model() -> None:
    own, chosen = some_model(1, 2), some_model(2, 3)
    wanted = answers(MoespKf(own))
    n4sid = n4sid_kf(replace(chosen, n4sid=beside(own), forecast=own.forecast))
    arx = arx_kf(replace(chosen, arx=beside(own), autoregression=None, forecast=own.forecast))
    assert (n4sid.name, arx.name) == ("n4sid_kf", "arx_kf")
    assert np.array_equal(answers(n4sid), wanted, equal_nan=True)
    assert np.array_equal(answers(arx), wanted, equal_nan=True)
    assert not np.array_equal(answers(MoespKf(chosen)), wanted, equal_nan=True)


def test_without_lags_arx_kf_goes_by_the_autoregression_of_the_arm() -> None:
    model = static_model()
    faster = replace(slow_movement(), Re=4 * slow_movement().Re)
    estimator = arx_kf(replace(model, arx=beside(model), autoregression=faster))
    assert isinstance(estimator, InnovationsKf)
    assert estimator.name == "arx_kf"
    assert estimator.model.innovations is faster
    wanted = answers(InnovationsKf(replace(model, innovations=faster)))
    assert np.array_equal(answers(estimator), wanted, equal_nan=True)


def test_a_model_file_without_the_model_is_named() -> None:
    model = replace(static_model(), n4sid=None, arx=None)
    with pytest.raises(DataError, match="n4sid_kf needs the model that n4sid finds"):
        n4sid_kf(model)
    with pytest.raises(DataError, match="arx_kf needs the model that arx finds"):
        arx_kf(model)
