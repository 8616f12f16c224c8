"""One hand at the patient: its channels, what has arrived of it, its estimators and its arm."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

import numpy as np

from common.channels import HandChannels
from common.messages import Pose, Vector3
from common.records import FreshNote
from patient_side.estimators.protocol import Estimate, Estimator
from patient_side.plant import Plant
from patient_side.playout import Playout
from patient_side.statespace import Array


def vector(values: Array) -> Vector3:
    """Return a position (3,) as it is written."""
    x, y, z = values.tolist()
    return Vector3(x=x, y=y, z=z)


def finite(values: Array | None) -> Array | None:
    """Return ``values`` if there are any and all are finite; what is not finite counts as missing."""
    return values if values is not None and isfinite(values.sum()) else None


def std_m(where_m: Array | None, estimate: Estimate) -> Vector3 | None:
    """Return the deviation that an estimate states, per axis; None where it has no position or states none."""
    covariance = estimate.covariance_m2
    deviation_m = None if where_m is None or covariance is None else finite(np.sqrt(np.diag(covariance)))
    return None if deviation_m is None else vector(deviation_m)


@dataclass
class PatientHand:
    """One hand: its channels, what has arrived of it, its estimators (the first is the active one) and its arm.

    ``freshest`` is the newest sample of either stream, ``pose`` the newest of the arm. ``prompt_ns`` is the arrival
    that waits for an answer of its own.
    """

    channels: HandChannels
    playout: Playout
    estimators: Sequence[Estimator]
    plant: Plant | None
    states: list[Any] = field(init=False)
    plant_state: Any = field(init=False)
    freshest: FreshNote | None = None
    used_sample_ns: int = -1
    answered_sample_ns: int = -1
    prompt_ns: int | None = None
    n_answers: int = 0
    pose: Pose | None = None

    def __post_init__(self) -> None:
        self.states = [estimator.initial() for estimator in self.estimators]
        self.plant_state = None if self.plant is None else self.plant.initial()
