"""Structures chosen over a synthetic population: isotropic people, and people of whom one axis is slower."""

from collections.abc import Iterator

import numpy as np
import scipy

from tis.common.scenario.source import SyntheticSource
from tis.common.sources.population import population
from tis.patient_side.identification.fit_innovations import fit_innovations
from tis.patient_side.linear_system import Array

RATE_HZ = 30
N_PEOPLE = 6
N_ROWS = 1200
SOURCE = SyntheticSource(kind="synthetic", hands=("left", "right"), recorder_hz=51.33)


def hands_of_people(seed: int) -> Iterator[Array]:
    """Yield both arms' positions of each person."""
    for recording in population(SOURCE, seed, N_PEOPLE, 1, RATE_HZ, N_ROWS):
        for hand in recording.hands:
            yield hand.follower.position_m


def with_a_slow_axis(position_m: Array) -> Array:
    """Return positions whose third axis has a bandwidth of 1 Hz only."""
    b, a = scipy.signal.butter(2, 1.0, fs=RATE_HZ)
    slow = scipy.signal.lfilter(b, a, position_m[:, 2] - position_m[0, 2])
    return np.column_stack([position_m[:, :2], slow])


def test_people_who_move_alike_in_every_direction_get_an_isotropic_model() -> None:
    fitted = fit_innovations([(y[:, :0], y) for y in hands_of_people(1)], RATE_HZ, 10)
    assert fitted.model.isotropic
    best = {structure.isotropic: min(by_order.values()) for structure, by_order in fitted.errors.items()}
    assert best[True] < best[False]
    assert fitted.warnings == ()


def test_people_with_a_slower_axis_get_a_free_model() -> None:
    slowed = [with_a_slow_axis(y) for y in hands_of_people(2)]
    fitted = fit_innovations([(y[:, :0], y) for y in slowed], RATE_HZ, 10)
    assert not fitted.model.isotropic
    best = {structure.isotropic: min(by_order.values()) for structure, by_order in fitted.errors.items()}
    assert best[False] < 0.98 * best[True]
