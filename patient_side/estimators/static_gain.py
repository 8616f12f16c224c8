"""Static gain: the freshest command through the model's gain, as if the hand had stopped there."""

from dataclasses import dataclass, field

import numpy as np

from tis.patient_side.estimators.protocol import Estimate
from tis.patient_side.playout import Playout
from tis.patient_side.statespace import ArmModel, Array, StateSpace

_MAX_PAIRS_TRIED = 100


def dc_gain(space: StateSpace) -> Array:
    """Return ``D + C (I - A)^-1 B`` (p, m), the response to a constant input; D for a static relation.

    Where A has an eigenvalue 1 there is no steady state, and the result is the least-squares solution.
    Oracle: a long simulation.
    """
    n = space.order
    return np.asarray(space.D + space.C @ np.linalg.lstsq(np.eye(n) - space.A, space.B)[0])


@dataclass(frozen=True)
class StaticGain:
    """No estimate while no command has arrived, and no covariance.

    Where a gain is the whole relation, it holds about the freshest instant whose command and position have both
    arrived, as set-ups differ and a clutch moves the offset. Otherwise, and before, about the operating point.
    """

    model: ArmModel
    name: str = "static_gain"
    _gain: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_gain", dc_gain(self.model.space))

    def initial(self) -> None:
        """Return the state: there is none."""

    def step(self, state: None, playout: Playout, now_ns: int) -> tuple[None, Estimate]:  # noqa: ARG002  protocol
        """Return the position at which the freshest command would hold the arm."""
        command = playout.command.get(playout.command.newest)
        if command is None:
            return None, Estimate(None)
        known_command, known_arm = self._known(playout)
        return None, Estimate(self._gain @ (command - known_command) + known_arm)

    def _known(self, playout: Playout) -> tuple[Array, Array]:
        """Return a command (3,) and the position (3,) at which it holds the arm."""
        if self.model.static:
            index = min(playout.arm.newest, playout.command.newest)
            for _ in range(_MAX_PAIRS_TRIED):
                arm, command = playout.arm.get(index), playout.command.get(index)
                if arm is not None and command is not None:
                    return command, arm
                index = playout.arm.newest_before(index)
        return self.model.input_offset_m, self.model.output_offset_m
