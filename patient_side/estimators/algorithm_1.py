"""Algorithm 1 of the paper on packets: the part that `paper` and `paper_as_printed` share, one iteration a tick.

In the paper a tick reads ``PSM[del_k]``, or the previous y again where the packet is lost. Here it reads the arm
sample that *arrived* last, whatever its source stamp: the previous one again where nothing has arrived since the last
tick, and the last one of several arrivals between two ticks. Its age is ignored: it counts as the present sample. The
paper's delays also let a tick read a sample of the future, or one that an earlier tick has already read before a
fresher one; packets cannot do either, as each arrives once, after it was sent.

``MTM[k-1]`` is the command one sample before the newest sample instant, if it has arrived. In the topology
`observer`, the paper's, it always has; in `teleoperation` the command that arrived last stands in. Commands that
arrive later are never applied retroactively.
"""

from typing import NamedTuple

import numpy as np

from tis.common.messages import MAX_SIZE
from tis.common.units import NS_PER_S
from tis.patient_side.playout import Playout, SourceBuffer
from tis.patient_side.statespace import ArmModel, Array


class PaperState(NamedTuple):
    """The paper's x_est[k] (n,) about the operating point, and P (n, n)."""

    x: Array
    P: Array


class Reading(NamedTuple):
    """The paper's MTM[k-1] (m,) and y (p,), about the operating point; zero while nothing has arrived."""

    u: Array
    y: Array


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
