"""The paper's Kalman filter to the letter of its Algorithm 1, flaws and all, on packets.

For every output channel it restarts from x_pred and P_pred, so that the last channel alone is assimilated. It
drops D, and takes a stale measurement for the present one.
"""

from dataclasses import dataclass

import numpy as np

from patient_side.estimators.algorithm_1 import PaperState, Reading, position_m, read, start
from patient_side.estimators.protocol import Estimate
from patient_side.playout import Playout
from patient_side.statespace import ArmModel


@dataclass(frozen=True)
class PaperAsPrinted:
    """Answers from the first tick, then at the operating point; one that has diverged says nothing.

    It claims no covariance: P is not that of its error. Oracle: `paper_filter` on the same draws.
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
            K = P_pred @ c / (c @ P_pred @ c + noise.R[d, d])
            x = x_pred + K * (y[d] - c @ x_pred)
            P = (np.eye(len(c)) - np.outer(K, c)) @ P_pred
        return PaperState(x, P)
