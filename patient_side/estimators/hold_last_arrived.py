"""Hold the last arrival: the arm stays at the sample that arrived last, however old it is.

The behaviour of a receiver that ignores source stamps: an overtaken packet moves the arm back in time.
"""

from dataclasses import dataclass

from tis.patient_side.estimators.protocol import Estimate
from tis.patient_side.playout import Playout


@dataclass(frozen=True)
class HoldLastArrived:
    """No estimate while no sample of the arm has arrived, and no covariance."""

    name: str = "hold_last_arrived"

    def initial(self) -> None:
        """Return the state: there is none."""

    def step(self, state: None, playout: Playout, now_ns: int) -> tuple[None, Estimate]:  # noqa: ARG002  protocol
        """Return the position of the arm that arrived last."""
        return None, Estimate(playout.arm.get(playout.arm.last_arrived))
