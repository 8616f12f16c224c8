"""Estimator wrapper that records the values a log does not keep: full covariance and CPU time of a step.

CPU time of the thread, because comparisons use all cores and waiting for one is not a property of an estimator.
"""

import time
from typing import Any

import numpy as np

from tis.patient_side.estimators.protocol import Estimate, Estimator
from tis.patient_side.node import PatientNode
from tis.patient_side.playout import Playout
from tis.patient_side.statespace import Array

_NONE = np.full((3, 3), np.nan)


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
        self._covariances.append(_NONE if estimate.covariance_m2 is None else estimate.covariance_m2)
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
