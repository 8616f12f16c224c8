"""Orientation method wrapper that records its estimates, covariances and CPU times, one entry per tick."""

import time
from typing import Any

import numpy as np

from tis.common.scenario.orientation import OrientationMethod
from tis.patient_side.estimators.protocol import Estimate, Estimator
from tis.patient_side.node import PatientNode
from tis.patient_side.orientation.protocol import WristEstimate, WristMethod
from tis.patient_side.playout import Playout, SourceBuffer
from tis.patient_side.statespace import Array

# Estimator wrapper that records the values a log does not keep: full covariance and CPU time of a step.
#
# CPU time of the thread, because comparisons use all cores and waiting for one is not a property of an estimator.

_NO_POSITION = np.full((3, 3), np.nan)


class MeasuredEstimator:
    """Wrapper that passes everything through unchanged and records one entry per tick."""

    def __init__(self, estimator: Estimator) -> None:
        self.inner = estimator
        self.name = estimator.name
        self.steps_ns: list[int] = []
        self._covariances: list[Array] = []

    @property
    def covariances_m2(self) -> Array:
        """Return the covariances (T, 3, 3), NaN without one."""
        return np.array(self._covariances, dtype=float).reshape(-1, 3, 3)

    def initial(self) -> Any:
        """Return the estimator's initial state."""
        return self.inner.initial()

    def step(self, state: Any, playout: Playout, now_ns: int) -> tuple[Any, Estimate]:
        """Return the wrapped estimator's step; an exception names the estimator."""
        begun_ns = time.thread_time_ns()
        try:
            state, estimate = self.inner.step(state, playout, now_ns)
        except Exception as error:
            raise RuntimeError(f"{self.name} at {now_ns * 1e-9:.3f} s: {type(error).__name__}: {error}") from error
        self.steps_ns.append(time.thread_time_ns() - begun_ns)
        self._covariances.append(_NO_POSITION if estimate.covariance_m2 is None else estimate.covariance_m2)
        return state, estimate


def measure_estimators(patient: PatientNode) -> list[dict[str, MeasuredEstimator]]:
    """Wrap every estimator of the patient; return the wrappers by name, one dictionary per hand.

    Estimates at arrivals are switched off, so that each step is a tick; they do not change the estimates at ticks.
    """
    patient.on_arrival = False
    watched = []
    for hand in patient.hands:
        measured = [MeasuredEstimator(estimator) for estimator in hand.estimators]
        hand.estimators = measured
        watched.append({estimator.name: estimator for estimator in measured})
    return watched


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
