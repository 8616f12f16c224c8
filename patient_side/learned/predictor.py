"""A trained model as a function of the recent path and an age."""

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

import numpy as np

from tis.common.errors import DataError, Fault
from tis.patient_side.learned.gaussian_process import N_FEATURES, at_ages, features_of, outputs, shapes_of
from tis.patient_side.learned.inputs import Window, age_inputs, has_gap, inputs_of, scaled
from tis.patient_side.learned.networks import NETWORKS
from tis.patient_side.learned_model import VERSION, LearnedModel
from tis.patient_side.model_fields import Floats

MAX_AGE: Final = 150.0
"""Age in steps beyond which what is left stays constant: 5 s."""
PROCESSES: Final = ("gpr", "srlsmf", "srlsmf_l1")


class Predicted(NamedTuple):
    """What the linear forecast leaves: its mean (3,) and the logarithm of its deviation, in units of the forecast's.

    ``covariance_scale`` calibrates the covariance at this age.
    """

    mean: Floats
    log_deviation: float
    covariance_scale: float


Predictor = Callable[[Window, Floats, float, Floats], Predicted]
"""From a window (B = 1), its activity (1,), the age in steps and the linear move (3,) in units to what is left."""


def predictor_of(model: LearnedModel) -> Predictor:
    """Return the function of a model; raises `DataError` where it is of another version, or for other inputs."""
    check_model(model)
    at, log_scales = np.log(model.scale_ages), np.log(model.covariance_scale)

    def calibrated(window: Window, age: float, mean: Floats, log_deviation: float) -> Predicted:
        x, row = np.log(age), int(has_gap(window.present)[0])
        share, scale = np.interp(x, at, model.mean_share), np.exp(np.interp(x, at, log_scales[row]))
        return Predicted(share * mean, log_deviation, float(scale))

    usual_m, spread_rad = model.usual_m, model.gripper_spread_rad
    if model.method in PROCESSES:

        def of_process(window: Window, activity: Floats, age: float, move: Floats) -> Predicted:  # noqa: ARG001
            mean, deviation = outputs(model.weights, features_of(scaled(window, activity, usual_m, spread_rad)))
            means, deviations = at_ages(mean, deviation, np.array([[age]]))
            return calibrated(window, age, means[0, 0], float(np.log(deviations[0, 0])))

        return of_process
    network = NETWORKS[model.method]

    def of_network(window: Window, activity: Floats, age: float, move: Floats) -> Predicted:
        inputs = inputs_of(np, scaled(window, activity, usual_m, spread_rad), zero_lost=network.zero_lost)
        ages, moves = age_inputs(np.array([[age]])), move.astype(np.float32)[None, None]
        mean, log_deviation = network(np, model.weights, *inputs, ages, moves)
        return calibrated(window, age, mean[0, 0].astype(float), float(log_deviation[0, 0]))

    return of_network


def check_model(model: LearnedModel) -> None:
    """Raise `DataError` with all reasons why a model cannot be used."""
    if model.version != VERSION:
        again = f"`tis identify --set identification.method={model.method}`"
        rule = f"must be version {VERSION}; train it again with {again}"
        raise DataError(Fault("model", f"learned.{model.method}.version", rule, model.version))
    expected: Mapping[str, tuple[int, ...]]
    if model.method in PROCESSES:
        points = model.weights.get("points")
        if points is None or points.ndim != 2 or points.shape[1] != N_FEATURES:
            rule = f"must be an array (points, {N_FEATURES}), one column for each input"
            where = f"learned.{model.method}.points"
            missing = Fault("model", where, f"is missing: {rule}")
            raise DataError(missing if points is None else Fault("model", where, rule, points.shape))
        expected = shapes_of(model.weights)
    else:
        expected = NETWORKS[model.method].shapes
    faults = []
    for name in sorted({*expected, *model.weights}):
        found = model.weights[name].shape if name in model.weights else None
        where = f"learned.{model.method}.{name}"
        if name not in expected:
            faults.append(Fault("model", where, "is no array of this method", found))
        elif found is None:
            faults.append(Fault("model", where, f"is missing: must be an array {expected[name]}"))
        elif found != expected[name]:
            faults.append(Fault("model", where, f"must be an array {expected[name]}", found))
        elif not np.isfinite(model.weights[name]).all():
            faults.append(Fault("model", where, "must be finite"))
    if faults:
        raise DataError(faults)
