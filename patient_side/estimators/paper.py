"""The paper's Kalman filter with its update repaired: x and P are carried from channel to channel.

The rest is Algorithm 1 as printed: D is dropped, and a stale measurement is used as the present one.
"""

from dataclasses import dataclass

import numpy as np

from tis.patient_side.estimators.paper_as_printed import PaperState, Reading, paper_model, position_m, read, start
from tis.patient_side.estimators.protocol import Estimate
from tis.patient_side.filters.kalman import kalman_predict, kalman_update
from tis.patient_side.linear_system import Array
from tis.patient_side.playout import Playout
from tis.patient_side.statespace import ArmModel


@dataclass(frozen=True)
class Paper:
    """An estimate from the first tick on, at first the operating point; none once the filter has diverged.

    Its covariance C P C' is the filter's own, which ignores the age of its measurements. A model without states has
    none. Oracle: `paper_filter` on the same draws.
    """

    model: ArmModel
    name: str = "paper"

    def initial(self) -> None:
        """Return the state before the first tick: none."""

    def step(self, state: PaperState | None, playout: Playout, now_ns: int) -> tuple[PaperState, Estimate]:
        """Return the state after one iteration (none at the first tick), and its C x with C P C'."""
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            if state is None:
                state = start(self.model)
            elif self.model.space.order:
                state = self._iterate(state, read(self.model, playout, now_ns))
            position = position_m(self.model, state)
            return state, Estimate(position, None if position is None else self._covariance(state))

    def _iterate(self, state: PaperState, reading: Reading) -> PaperState:
        space, noise = self.model.space, self.model.noise
        x, P = kalman_predict(*state, space.A, noise.Q, space.B.dot(reading.u))
        for d in range(len(space.C)):
            only = slice(d, d + 1)
            # The reciprocal inverts the one variance, and unlike a matrix inverse does not raise on divergence.
            x, P = kalman_update(x, P, reading.y[only], space.C[only], noise.R[only, only], np.reciprocal)
        return PaperState(x, P)

    def _covariance(self, state: PaperState) -> Array | None:
        C = self.model.space.C
        covariance = C @ state.P @ C.T
        return (covariance + covariance.T) / 2.0 if self.model.space.order else None


def paper(model: ArmModel) -> Paper:
    """Return the estimator on the paper's model."""
    return Paper(paper_model(model))
