"""Forecasts of the estimators in one twin: the positions 1, 2, ... samples after their newest sample.

An estimator steps to an instant, and keeps all that changes in its state. So a step to a later instant, whose state
is discarded, is the estimate that it would give there if everything were late by a constant delay: one twin yields
the forecasts over all horizons. Oracle: twins with these delays, in the tests.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tis.common.metrics.tracking import SETTLING_NS
from tis.common.scenario import Scenario
from tis.common.sources.trajectory import Recording
from tis.common.units import sample_index, sample_instant_ns
from tis.deploy.compare.cells.measured import MeasuredEstimator, measure_estimators
from tis.deploy.compare.cells.unlogged import NoLog
from tis.deploy.run.twin import build_sides, drive
from tis.patient_side.estimators.protocol import Estimate
from tis.patient_side.node import PatientNode
from tis.patient_side.playout import Playout

Array = NDArray[np.float64]

ORIGIN_EVERY: Final = 3
"""Samples between two origins of forecasts: 10 origins/s at 30 samples/s."""

_NONE: Final = np.full(3, np.nan)
_SUMS: Final = ("distance_m", "absolute_m", "squares_m2")


@dataclass(frozen=True)
class ErrorSums:
    """Sums over ``n`` forecasts of 1, 2, ... H samples ahead, in m and m^2: every definition of an error follows.

    ``distance_m`` (H,) sums the 3D distances, ``absolute_m`` and ``squares_m2`` (H, 3) the errors of each axis.
    """

    n: int
    distance_m: Array
    absolute_m: Array
    squares_m2: Array

    @classmethod
    def of(cls, errors_m: Array) -> "ErrorSums":
        """Return the sums of errors (N, H, 3) in m. Oracle: values by hand in the tests."""
        squares = errors_m**2
        distances = np.sqrt(squares.sum(axis=2)).sum(axis=0)
        return cls(len(errors_m), distances, np.abs(errors_m).sum(axis=0), squares.sum(axis=0))

    @classmethod
    def total(cls, parts: Iterable["ErrorSums"]) -> "ErrorSums | None":
        """Return the sums over all parts, None without a part."""
        found = list(parts)
        if not found:
            return None
        each = ([getattr(part, name) for part in found] for name in _SUMS)
        return cls(sum(part.n for part in found), *(np.sum(of_parts, axis=0) for of_parts in each))

    @classmethod
    def from_json(cls, raw: dict[str, Any]) -> "ErrorSums":
        """Return the sums that `to_json` wrote."""
        return cls(raw["n"], *(np.array(raw[name]) for name in _SUMS))

    def to_json(self) -> dict[str, Any]:
        """Return the sums as JSON values."""
        return {"n": self.n, **{name: getattr(self, name).tolist() for name in _SUMS}}


class ForecastRecorder:
    """Wrapper that passes every step through, and records the forecasts from every third sample."""

    def __init__(self, measured: MeasuredEstimator, n_ahead: int) -> None:
        self.measured = measured
        self.name = measured.name
        self.forecasts_m: dict[int, Array] = {}
        self._n_ahead = n_ahead

    def initial(self) -> Any:
        """Return the estimator's initial state."""
        return self.measured.initial()

    def step(self, state: Any, playout: Playout, now_ns: int) -> tuple[Any, Estimate]:
        """Return the wrapped estimator's step."""
        state, estimate = self.measured.step(state, playout, now_ns)
        newest = playout.arm.newest
        if newest >= 0 and newest % ORIGIN_EVERY == 0 and newest not in self.forecasts_m:
            self.forecasts_m[newest] = self._forecast(state, playout, newest)
        return state, estimate

    def _forecast(self, state: Any, playout: Playout, newest: int) -> Array:
        """Return the positions at the samples after the newest (H, 3), NaN for none."""
        found = []
        for ahead in range(1, self._n_ahead + 1):
            instant_ns = sample_instant_ns(newest + ahead, playout.rate_hz)
            position = self.measured.inner.step(state, playout, instant_ns)[1].position_m
            found.append(_NONE if position is None else position)
        return np.array(found)


def forecasts_of_twin(scenario: Scenario, recording: Recording, n_ahead: int) -> dict[str, dict[str, Any]]:
    """Run a twin; return the sums of the forecasts of so many samples after the newest."""
    nodes, _, _ = build_sides(scenario, recording=recording)
    patient = nodes["patient"]
    assert isinstance(patient, PatientNode)
    measure_estimators(patient)
    recorders = record_forecasts(patient, n_ahead)
    drive(scenario, nodes, {side: NoLog() for side in nodes})
    return forecast_sums(recording, recorders)


def record_forecasts(patient: PatientNode, n_ahead: int) -> list[dict[str, ForecastRecorder]]:
    """Wrap every measured estimator of the patient; return the wrappers by name, one dictionary per hand."""
    recorders = []
    for hand in patient.hands:
        wrapped = [ForecastRecorder(each, n_ahead) for each in hand.estimators if isinstance(each, MeasuredEstimator)]
        hand.estimators = wrapped
        recorders.append({recorder.name: recorder for recorder in wrapped})
    return recorders


def forecast_sums(
    recording: Recording, recorders: Sequence[dict[str, ForecastRecorder]]
) -> dict[str, dict[str, Any]]:
    """Return the sums of the forecasts' errors, by hand and estimator.

    The origins are the same for all: from the settling time on, as far as the recording holds every later sample. A
    missing forecast counts with hold's, as in the scores.
    """
    found: dict[str, dict[str, Any]] = {}
    first = sample_index(SETTLING_NS, recording.rate_hz)
    for hand, by_name in zip(recording.hands, recorders, strict=True):
        truth_m = hand.follower.position_m[recording.start :]
        hold = by_name["hold"].forecasts_m
        n_ahead = len(next(iter(hold.values()), ()))
        origins = [origin for origin in hold if first <= origin < len(truth_m) - n_ahead]
        ahead = np.add.outer(np.array(origins, dtype=int), np.arange(1, n_ahead + 1))
        held = np.array([hold[origin] for origin in origins]).reshape(-1, n_ahead, 3)
        found[hand.hand] = {}
        for name, recorder in by_name.items():
            positions = np.array([recorder.forecasts_m[origin] for origin in origins]).reshape(-1, n_ahead, 3)
            errors = np.where(np.isnan(positions), held, positions) - truth_m[ahead]
            found[hand.hand][name] = ErrorSums.of(errors).to_json()
    return found
