"""Hold: the arm stays at its freshest sample by source stamp. The reference of all scores."""

from dataclasses import dataclass

from tis.patient_side.estimators.protocol import Estimate
from tis.patient_side.playout import Playout


@dataclass(frozen=True)
class Hold:
    """No estimate while no sample of the arm has arrived, and no covariance."""

    name: str = "hold"

    def initial(self) -> None:
        """Return the state: there is none."""

    def step(self, state: None, playout: Playout, now_ns: int) -> tuple[None, Estimate]:  # noqa: ARG002  protocol
        """Return the freshest position of the arm."""
        return None, Estimate(playout.arm.get(playout.arm.newest))
