"""Hold the last arrival: the arm is where the packet that came in last saw it, however old it is.

What a receiver does that does not look at source stamps: a packet that was overtaken takes the arm back in time.
"""

from dataclasses import dataclass

from patient_side.estimators.protocol import Estimate
from patient_side.playout import Playout


@dataclass(frozen=True)
class HoldLastArrived:
    """Says nothing while no sample of the arm has arrived, and has no covariance."""

    name: str = "hold_last_arrived"

    def initial(self) -> None:
        """Return the state: there is none."""

    def step(
        self,
        state: None,  # noqa: ARG002  the protocol's
        playout: Playout,
        now_ns: int,  # noqa: ARG002  the protocol's
    ) -> tuple[None, Estimate]:
        """Return the position of the arm that arrived last."""
        return None, Estimate(playout.arm.get(playout.arm.last_arrived))
