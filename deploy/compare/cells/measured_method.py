"""Orientation method wrapper that records its estimates, covariances and CPU times, one entry per tick."""

import time

import numpy as np

from tis.common.scenario.patient import OrientationMethod
from tis.patient_side.node import PatientNode
from tis.patient_side.orientation.protocol import WristEstimate, WristMethod
from tis.patient_side.playout import SourceBuffer
from tis.patient_side.statespace import Array

_NO_ORIENTATION, _NO_COVARIANCE = np.full(4, np.nan), np.full((3, 3), np.nan)


class MeasuredMethod:
    """Wrapper that passes everything through unchanged."""

    def __init__(self, method: WristMethod) -> None:
        self.inner = method
        self.name: OrientationMethod = method.name
        self.steps_ns: list[int] = []
        self._estimates: list[WristEstimate] = []

    def estimate(self, arm: SourceBuffer, age_samples: float) -> WristEstimate:
        """Return the wrapped method's estimate."""
        begun_ns = time.thread_time_ns()
        found = self.inner.estimate(arm, age_samples)
        self.steps_ns.append(time.thread_time_ns() - begun_ns)
        self._estimates.append(found)
        return found

    @property
    def orientation(self) -> Array:
        """Return the orientations (T, 4), NaN for none."""
        found = [_NO_ORIENTATION if each.orientation is None else each.orientation for each in self._estimates]
        return np.array(found, dtype=float).reshape(-1, 4)

    @property
    def covariances_rad2(self) -> Array:
        """Return the covariances (T, 3, 3), NaN for none."""
        found = [_NO_COVARIANCE if each.covariance_rad2 is None else each.covariance_rad2 for each in self._estimates]
        return np.array(found, dtype=float).reshape(-1, 3, 3)

    @property
    def gripper_rad(self) -> Array:
        """Return the gripper's angles (T,), NaN for none."""
        return _numbers([each.gripper_rad for each in self._estimates])

    @property
    def gripper_variances_rad2(self) -> Array:
        """Return the variances (T,) of the gripper's angles, NaN for none."""
        return _numbers([each.gripper_variance_rad2 for each in self._estimates])


def measure_methods(patient: PatientNode) -> list[dict[str, MeasuredMethod]]:
    """Wrap every orientation method of the patient; return the wrappers by name, one dictionary per hand."""
    watched = []
    for hand in patient.hands:
        measured = [MeasuredMethod(method) for method in hand.methods]
        hand.methods = measured
        watched.append({str(method.name): method for method in measured})
    return watched


def _numbers(found: list[float | None]) -> Array:
    return np.array([np.nan if value is None else value for value in found], dtype=float)
