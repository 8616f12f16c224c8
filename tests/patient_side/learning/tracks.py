"""Tracks for training: movements that have something to learn, and quiet ones."""

from dataclasses import replace

import numpy as np

from tests.patient_side.arm_models import static_model
from tis.patient_side.estimators.innovations_kf import InnovationsKf
from tis.patient_side.estimators.learned_forecast import linear_forecast
from tis.patient_side.learning.examples import Examples, Track, examples_of

USUAL_M, SPREAD_RAD = 3e-4, 0.5


def linear() -> InnovationsKf:
    """The linear forecast of a hand whose velocity decays."""
    return linear_forecast(replace(static_model(), static=False))


def turning(seed: int, n: int = 400, group: str = "A") -> Track:
    """A hand that runs on circles of 1.5 s and a random speed: a linear model that decays does not know them."""
    rng = np.random.default_rng(seed)
    pace = np.exp(0.3 * rng.normal(size=n).cumsum() / np.sqrt(n))
    angle = (2 * np.pi / 45 * pace).cumsum()
    position = 5e-3 * np.stack([np.cos(angle), np.sin(angle), 0.1 * np.cos(angle)], axis=1)
    return Track(position + 1e-6 * rng.normal(size=(n, 3)), 0.5 * np.sin(angle / 3), group)


def some_examples(n_tracks: int = 4, seed: int = 1, n_passes: int = 1, n: int = 400) -> Examples:
    """Examples of circles, by two people in turn."""
    tracks = [turning(i, n, "AB"[i % 2]) for i in range(n_tracks)]
    return examples_of(tracks, linear(), USUAL_M, SPREAD_RAD, seed, n_passes)
