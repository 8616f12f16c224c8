"""Static gain: the freshest command through the model's gain, as if the hand had stopped since."""

from dataclasses import dataclass, field

import numpy as np

from patient_side.estimators.protocol import Estimate
from patient_side.playout import Playout
from patient_side.statespace import ArmModel, Array, StateSpace


def dc_gain(space: StateSpace) -> Array:
    """Return ``D + C (I - A)^-1 B`` (p, m), what a constant input settles at; D for a static relation.

    Where A has an eigenvalue 1 nothing settles and the least-squares solution stands in.
    Oracle: a long simulation.
    """
    n = space.order
    return np.asarray(space.D + space.C @ np.linalg.lstsq(np.eye(n) - space.A, space.B)[0])


@dataclass(frozen=True)
class StaticGain:
    """Says nothing while no command has arrived; takes no notice of the arm."""

    model: ArmModel
    name: str = "static_gain"
    _gain: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_gain", dc_gain(self.model.space))

    def initial(self) -> None:
        """Return the state: there is none."""

    def step(
        self,
        state: None,  # noqa: ARG002  the protocol's
        playout: Playout,
        now_ns: int,  # noqa: ARG002  the protocol's
    ) -> tuple[None, Estimate]:
        """Return where the freshest command would hold the arm."""
        command = playout.command.get(playout.command.newest)
        if command is None:
            return None, Estimate(None)
        return None, Estimate(self._gain @ (command - self.model.input_offset_m) + self.model.output_offset_m)
