"""The paper's Kalman filter exactly as its Algorithm 1 is printed, flaws included, on packets.

For every output channel it restarts from x_pred and P_pred, so that only the last channel is assimilated. It
drops D, and uses a stale measurement as the present one.
"""

from dataclasses import dataclass

import numpy as np

from tis.patient_side.estimators.algorithm_1 import PaperState, Reading, position_m, read, start
from tis.patient_side.estimators.protocol import Estimate
from tis.patient_side.filters.paper_kalman import printed_update
from tis.patient_side.playout import Playout
from tis.patient_side.statespace import ArmModel


@dataclass(frozen=True)
class PaperAsPrinted:
    """An estimate from the first tick on, at first the operating point; none once the filter has diverged.

    It states no covariance, as P is not that of its error. Oracle: `paper_filter` on the same draws.
    """

    model: ArmModel
    name: str = "paper_as_printed"

    def initial(self) -> None:
        """Return the state before the first tick: none."""

    def step(self, state: PaperState | None, playout: Playout, now_ns: int) -> tuple[PaperState, Estimate]:
        """Return the state after one iteration (none at the first tick), and its C x."""
        if state is None:
            state = start(self.model)
        else:
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                state = self._iterate(state, read(self.model, playout, now_ns))
        return state, Estimate(position_m(self.model, state))

    def _iterate(self, state: PaperState, reading: Reading) -> PaperState:
        space, noise, (u, y) = self.model.space, self.model.noise, reading
        x_pred = space.A @ state.x + space.B @ u
        P_pred = space.A @ state.P @ space.A.T + noise.Q
        x, P = x_pred, P_pred
        for d, c in enumerate(space.C):
            x, P = printed_update(x_pred, P_pred, y[d], c, noise.R[d, d])
        return PaperState(x, P)
