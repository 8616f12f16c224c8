"""Hold: the arm is where its freshest sample, by source stamp, saw it. The yardstick of all others."""

from dataclasses import dataclass

from patient_side.estimators.protocol import Estimate
from patient_side.playout import Playout


@dataclass(frozen=True)
class Hold:
    """Says nothing while no sample of the arm has arrived."""

    name: str = "hold"

    def initial(self) -> None:
        """Return the state: there is none."""

    def step(
        self,
        state: None,  # noqa: ARG002  the protocol's
        playout: Playout,
        now_ns: int,  # noqa: ARG002  the protocol's
    ) -> tuple[None, Estimate]:
        """Return the freshest position of the arm."""
        return None, Estimate(playout.arm.get(playout.arm.newest))
