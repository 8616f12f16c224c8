"""The paper's Algorithm 1 on packets exactly as printed, flaws included; `paper` shares its reading of packets.

For every output channel it restarts from x_pred and P_pred, so that only the last channel is assimilated. It
drops D, and uses a stale measurement as the present one.

In the paper a tick reads ``PSM[del_k]``, or the previous y again where the packet is lost. Here it reads the arm
sample that *arrived* last, whatever its source stamp: the previous one again where nothing has arrived since the last
tick, and the last one of several arrivals between two ticks. Its age is ignored: it counts as the present sample. The
paper's delays also let a tick read a sample of the future, or one that an earlier tick has already read before a
fresher one; packets cannot do either, as each arrives once, after it was sent.

``MTM[k-1]`` is the command one sample before the newest sample instant, if it has arrived. In the topology
`observer`, the paper's, it always has; in `teleoperation` the command that arrived last stands in. Commands that
arrive later are never applied retroactively.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tis.common.messages import MAX_SIZE
from tis.common.units import NS_PER_S
from tis.patient_side.estimators.protocol import Estimate
from tis.patient_side.filters.paper_kalman import printed_update
from tis.patient_side.linear_system import Array
from tis.patient_side.playout import Playout, SourceBuffer
from tis.patient_side.statespace import ArmModel, with_model


class PaperState(NamedTuple):
    """The paper's x_est[k] (n,) about the operating point, and P (n, n)."""

    x: Array
    P: Array


class Reading(NamedTuple):
    """The paper's MTM[k-1] (m,) and y (p,), about the operating point; zero while nothing has arrived."""

    u: Array
    y: Array


def paper_model(model: ArmModel) -> ArmModel:
    """Return the arm with the model of the paper's identification; unchanged where that is its own."""
    return model if model.paper is None else with_model(model, model.paper)


def start(model: ArmModel) -> PaperState:
    """Return the state at the first tick, x = 0 and P = I; the paper does not specify it."""
    n = model.space.order
    return PaperState(np.zeros(n), np.eye(n))


def read(model: ArmModel, playout: Playout, now_ns: int) -> Reading:
    """Return the command and the measurement that the iteration of the tick at ``now_ns`` reads."""
    newest_instant = ((now_ns + 1) * playout.rate_hz - 1) // NS_PER_S
    u = playout.command.get(newest_instant - 1)
    if u is None:
        u = _last_arrived(playout.command)
    y = _last_arrived(playout.arm)
    return Reading(
        np.zeros(model.space.n_inputs) if u is None else u - model.input_offset_m,
        np.zeros(model.space.n_outputs) if y is None else y - model.output_offset_m,
    )


def position_m(model: ArmModel, state: PaperState) -> Array | None:
    """Return the paper's ``z_est = C x_est`` (p,) in m, or None once the filter has diverged.

    D is dropped, as in the paper. A model without states stays at its operating point.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        position = model.space.C @ state.x + model.output_offset_m
    return position if np.all(np.abs(position) <= MAX_SIZE) else None


def _last_arrived(buffer: SourceBuffer) -> Array | None:
    return buffer.get(buffer.last_arrived)


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


def paper_as_printed(model: ArmModel) -> PaperAsPrinted:
    """Return the estimator on the paper's model."""
    return PaperAsPrinted(paper_model(model))
