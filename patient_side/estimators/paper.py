"""The paper's Kalman filter with its update repaired: x and P are carried from channel to channel.

The rest is Algorithm 1 as printed: D is dropped, and a stale measurement is taken for the present one.
"""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from patient_side.estimators.algorithm_1 import PaperState, Reading, position_m, read, start
from patient_side.estimators.protocol import Estimate
from patient_side.playout import Playout
from patient_side.statespace import ArmModel, Array

if TYPE_CHECKING:
    from filterpy.kalman import KalmanFilter


def _build_filter(model: ArmModel) -> "KalmanFilter":
    """Return filterpy's filter for one output channel at a time."""
    from filterpy.kalman import KalmanFilter  # loads scipy.stats, longer than all else

    kf = KalmanFilter(dim_x=model.space.order, dim_z=1)
    kf.F, kf.B, kf.Q = model.space.A, model.space.B, model.noise.Q
    # Of a single number it is the inverse, and unlike numpy's inverse it does not raise when a filter diverges.
    kf.inv = np.reciprocal
    return kf


@dataclass(frozen=True)
class Paper:
    """Answers from the first tick, then at the operating point; one that has diverged says nothing.

    Its covariance C P C' is what the filter believes, which leaves out the age of its measurements. A model
    without states has none. Oracle: `paper_filter` on the same draws.
    """

    model: ArmModel
    name: str = "paper"
    _kf: "KalmanFilter | None" = field(init=False, repr=False)

    def __post_init__(self) -> None:
        # Scratch space: every step loads its state first, so nothing of one step reaches the next.
        object.__setattr__(self, "_kf", _build_filter(self.model) if self.model.space.order else None)

    def initial(self) -> None:
        """Return the state before the first tick: none."""

    def step(self, state: PaperState | None, playout: Playout, now_ns: int) -> tuple[PaperState, Estimate]:
        """Return the state after one iteration (none at the first tick), and its C x with C P C'."""
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            if state is None:
                state = start(self.model)
            elif self._kf is not None:
                state = self._iterate(self._kf, state, read(self.model, playout, now_ns))
            position = position_m(self.model, state)
            return state, Estimate(position, None if position is None else self._covariance(state))

    def _iterate(self, kf: "KalmanFilter", state: PaperState, reading: Reading) -> PaperState:
        kf.x, kf.P = state
        kf.predict(u=reading.u)
        for d, c in enumerate(self.model.space.C):
            kf.update(reading.y[d], R=self.model.noise.R[d, d], H=c[None, :])
        return PaperState(kf.x, kf.P)

    def _covariance(self, state: PaperState) -> Array | None:
        C = self.model.space.C
        covariance = C @ state.P @ C.T
        return (covariance + covariance.T) / 2.0 if self._kf is not None else None
