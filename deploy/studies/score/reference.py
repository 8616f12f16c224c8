"""The reference loop: a fixed amount of plain Python a step, beside which the steps of the same twins are stated."""

from typing import Any, Final

from tis.patient_side.estimators.protocol import Estimate
from tis.patient_side.playout import Playout
from tis.patient_side.statespace import ArmModel

NAME: Final = f"{__name__}:ReferenceLoop"
N_ROUNDS: Final = 1000


class ReferenceLoop:
    """An estimator that estimates nothing, and takes its time: 1000 multiplications and additions."""

    def __init__(self, model: ArmModel) -> None:
        del model

    def initial(self) -> None:
        """Return nothing: there is no state."""

    def step(self, state: Any, playout: Playout, now_ns: int) -> tuple[Any, Estimate]:
        """Take the time, and return no estimate."""
        del playout, now_ns
        value = 1.0
        for _ in range(N_ROUNDS):
            value = 0.5 * value + 1.0
        return state, Estimate(None)
