"""What an estimator is: frozen parameters, an initial state, and a pure step on what has arrived."""

from typing import Any, NamedTuple, Protocol

from patient_side.playout import Playout
from patient_side.statespace import Array


class Estimate(NamedTuple):
    """Where the arm is at the tick: mean (3,) in m and covariance (3, 3) in m^2, or None where there is none."""

    position_m: Array | None
    covariance_m2: Array | None = None


class Estimator(Protocol):
    """Causal: it reads only what the playout buffer holds, that is, what has arrived by the tick.

    ``step`` changes neither ``state`` nor the buffer: a step may be asked for and its state thrown away. A user's own
    estimator, ``module:factory`` in a scenario, needs `initial` and `step` only (docs/how_to/own_estimator.md).
    """

    @property
    def name(self) -> str:
        """Return the name by which scenarios ask for it."""
        ...

    def initial(self) -> Any:
        """Return the state before the first arrival."""
        ...

    def step(self, state: Any, playout: Playout, now_ns: int) -> tuple[Any, Estimate]:
        """Return the new state and the estimate for run time ``now_ns``, the tick's nominal instant."""
        ...
