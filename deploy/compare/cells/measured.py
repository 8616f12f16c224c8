"""Wrappers of estimators and orientation methods that record what a log does not keep: covariances and CPU times.

CPU time of the thread, because comparisons use all cores and waiting for one is not a property of an estimator. One
that is a process of its own is waited for, and timed by the clock.
"""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from tis.common.scenario.patient import OrientationMethod
from tis.patient_side.estimators.protocol import Estimate, Estimator
from tis.patient_side.linear_system import Array
from tis.patient_side.node import PatientNode
from tis.patient_side.orientation.wrist import WristEstimate, WristMethod
from tis.patient_side.playout import Playout, SourceBuffer

_NO_COVARIANCE = np.full((3, 3), np.nan)


class MeasuredEstimator:
    """Wrapper that passes everything through unchanged and records one entry per tick."""

    def __init__(self, estimator: Estimator) -> None:
        self.inner = estimator
        self.name = estimator.name
        self.steps_ns: list[int] = []
        is_waited_for = getattr(getattr(estimator, "inner", None), "is_waited_for", False)
        self._now_ns = time.perf_counter_ns if is_waited_for else time.thread_time_ns
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
        begun_ns = self._now_ns()
        try:
            state, estimate = self.inner.step(state, playout, now_ns)
        except Exception as error:
            raise RuntimeError(f"{self.name} at {now_ns * 1e-9:.3f} s: {type(error).__name__}: {error}") from error
        self.steps_ns.append(self._now_ns() - begun_ns)
        self._covariances.append(_NO_COVARIANCE if estimate.covariance_m2 is None else estimate.covariance_m2)
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


class MeasuredMethod:
    """Wrapper that passes everything through unchanged and records one estimate per tick."""

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
        return _filled([each.orientation for each in self._estimates], 4)

    @property
    def covariances_rad2(self) -> Array:
        """Return the covariances (T, 3, 3), NaN for none."""
        return _filled([each.covariance_rad2 for each in self._estimates], 3, 3)

    @property
    def gripper_rad(self) -> Array:
        """Return the gripper's angles (T,), NaN for none."""
        return _filled([each.gripper_rad for each in self._estimates])

    @property
    def gripper_variances_rad2(self) -> Array:
        """Return the variances (T,) of the gripper's angles, NaN for none."""
        return _filled([each.gripper_variance_rad2 for each in self._estimates])


def measure_methods(patient: PatientNode) -> list[dict[str, MeasuredMethod]]:
    """Wrap every orientation method of the patient; return the wrappers by name, one dictionary per hand."""
    watched = []
    for hand in patient.hands:
        measured = [MeasuredMethod(method) for method in hand.methods]
        hand.methods = measured
        watched.append({str(method.name): method for method in measured})
    return watched


def _filled(found: Sequence[Any], *shape: int) -> Array:
    """Return the values (T, *shape), NaN for None."""
    nothing = np.full(shape, np.nan)
    return np.array([nothing if value is None else value for value in found], dtype=float).reshape(-1, *shape)
