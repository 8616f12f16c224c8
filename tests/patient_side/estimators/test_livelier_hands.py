"""Hands that are livelier than a model of rows without noise: their movements are no jumps."""

from dataclasses import replace

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
    truth_at_ticks,
)
from tests.patient_side.movements import drawn, movement_model, moving_arm
from tis.common.scenario.source import SyntheticSource
from tis.common.sources.population import population
from tis.common.units import NS_PER_S
from tis.patient_side.estimators.innovations_kf import InnovationsKf
from tis.patient_side.identification.fit_innovations import fit_autoregression
from tis.patient_side.linear_system import Array

LAG = 3
N_TRAINED = 4


def over_hold(estimator: InnovationsKf, y: Array, first: int = 60) -> float:
    arrivals = delayed(len(y), LAG * NS_PER_S // RATE_HZ)
    said = positions(play(estimator, Streams(np.zeros_like(y), y, [LOST] * len(y), arrivals)))
    return ratio_to_hold(said[first:-1], y[first - LAG : -1 - LAG], truth_at_ticks(y)[first:-1])


@pytest.mark.parametrize("seed", [5, 14])
def test_of_no_person_is_the_error_above_that_of_hold(seed: int) -> None:
    """By the innovations alone, small where there is no noise, turns of the lively would be jumps."""
    source = SyntheticSource(kind="synthetic", hands=("left",))
    people = [each.hands[0].follower.position_m for each in population(source, seed, 11, 1, RATE_HZ, 900)]
    found = fit_autoregression([(y, y) for y in people[:N_TRAINED]], RATE_HZ, 10)
    estimator = InnovationsKf(moving_arm(found))
    assert max(over_hold(estimator, y[:600]) for y in people[N_TRAINED:]) < 1.0


def test_what_goes_on_as_it_began_was_no_jump() -> None:
    """It moves off at a thousand deviations a sample: from the second on the velocity is corrected."""
    eye = np.eye(3)
    model = replace(movement_model(3, integrated=True), A=0.95 * eye, C=eye, K=0.9 * eye)
    y = drawn(model, 120, np.random.default_rng(2))
    y[:, 0] += 1e3 * np.sqrt(np.trace(model.Re)) * np.maximum(np.arange(120) - 60, 0)
    assert over_hold(InnovationsKf(moving_arm(model)), y, 90) < 0.5
