from dataclasses import replace

import numpy as np

from tests.patient_side.movements import movement_model
from tis.patient_side.filters.innovations_filter import build_innovations_filter
from tis.patient_side.filters.replay import MAX_WINDOW, replay_window
from tis.patient_side.filters.unbroken import Unbroken
from tis.patient_side.identification.stochastic_moesp import innovations_form
from tis.patient_side.movement_models import InnovationsModel


def window(model: InnovationsModel) -> int:
    filter_ = build_innovations_filter(model, 30)
    return replay_window(filter_, Unbroken.of(filter_, 700))


def moving(persistence: float, noise: float) -> InnovationsModel:
    """A velocity that persists, measured as positions with white noise: increments are v[k] + n[k] - n[k-1]."""
    eye, none = np.eye(3), np.zeros((3, 3))
    A, C = np.block([[persistence * eye, none], [none, none]]), np.hstack([eye, -eye])
    Q, R = np.block([[eye, none], [none, noise**2 * eye]]), noise**2 * eye
    form = innovations_form(A, C, Q, R, np.vstack([none, R]))
    return replace(movement_model(3, integrated=True), A=A, C=C, K=form.K, Re=form.Re)


def test_of_a_random_walk_no_late_sample_tells_anything() -> None:
    eye = np.eye(3)
    walk = replace(movement_model(3, integrated=True), A=0.5 * eye, C=eye, K=np.zeros((3, 3)))
    assert window(walk) == 0


def test_of_a_movement_that_goes_on_the_samples_next_to_the_newest_are_worth_it() -> None:
    assert 0 < window(moving(0.95, 0.01)) < 5


def test_sensor_noise_makes_more_of_them_worth_it() -> None:
    some, much = window(moving(0.95, 1.0)), window(moving(0.95, 30.0))
    assert some < much <= MAX_WINDOW
