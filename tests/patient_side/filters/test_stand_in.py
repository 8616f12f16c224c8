from dataclasses import replace

import numpy as np
import pytest

from tests.patient_side.arm_models import (
    RATE_HZ,
    arm_model,
    at_operating_point,
    random_noise,
    random_space,
    static_model,
)
from tis.patient_side.filters.stand_in import StandIn
from tis.patient_side.playout import Playout


def playout_with(offset_m: float, n: int) -> Playout:
    playout, rng = Playout(RATE_HZ), np.random.default_rng(0)
    for i in range(n):
        u = rng.normal(size=3)
        playout.command.add(i, u)
        playout.arm.add(i, 0.5 * u + offset_m + 0.01 * (-1) ** i)
    return playout


def test_the_offset_is_the_mean_over_pairs_and_its_error_counts() -> None:
    stand_in = StandIn.of(static_model(noise_m=1e-3))
    assert stand_in is not None
    offset = stand_in.offset((2, 3, 4, 5), playout_with(0.3, 8))
    assert np.allclose(offset.offset_m, 0.3)
    assert np.allclose(offset.error_m2, 1.25e-6 * np.eye(3))


def test_pairs_that_are_gone_from_the_buffer_do_not_count() -> None:
    stand_in = StandIn.of(static_model(noise_m=1e-3))
    assert stand_in is not None
    offset = stand_in.offset((6, 90), playout_with(0.3, 8))
    assert np.allclose(offset.offset_m, 0.31)
    assert np.allclose(offset.error_m2, 2e-6 * np.eye(3))


@pytest.mark.parametrize(("train", "deviation_m"), [("own_head", 1e-3), ("others", 0.1)])
def test_without_pairs_it_is_the_operating_points(train: str, deviation_m: float) -> None:
    model = at_operating_point(static_model(noise_m=1e-3), [0.2, 0.0, 0.0], [1.0, 2.0, 3.0])
    stand_in = StandIn.of(replace(model, train=train))
    assert stand_in is not None
    guess = stand_in.offset((), Playout(RATE_HZ))
    assert np.allclose(guess.offset_m, [0.9, 2.0, 3.0])
    assert np.allclose(np.sqrt(np.diag(guess.error_m2)), deviation_m, rtol=1e-3)


def test_a_model_with_states_has_none() -> None:
    rng = np.random.default_rng(0)
    assert StandIn.of(arm_model(random_space(rng, 2), random_noise(rng, 2, 1e-4, 1e-5))) is None
