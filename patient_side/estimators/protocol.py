"""The interface of an estimator: frozen parameters, an initial state, and a pure step on the arrived samples."""

from typing import Any, NamedTuple, Protocol

from tis.patient_side.linear_system import Array
from tis.patient_side.playout import Playout


class Estimate(NamedTuple):
    """The arm's position at the tick: mean (3,) in m and covariance (3, 3) in m^2, or None where there is none."""

    position_m: Array | None
    covariance_m2: Array | None = None


class Estimator(Protocol):
    """An estimator of the arm's present position.

    It is causal, as it reads only the playout buffer, that is, what has arrived by the tick. It keeps everything that
    changes in its state, so that a step may be repeated, or computed and discarded: ``step`` changes neither
    ``state`` nor the buffer. A user-defined estimator, ``module:factory`` in a scenario, needs `initial` and `step`
    only (docs/testbed/own_estimator.md).

    Examples
    --------
    >>> class Freshest:
    ...     name = "freshest"
    ...
    ...     def initial(self):
    ...         return None
    ...
    ...     def step(self, state, playout, now_ns):
    ...         return state, Estimate(playout.arm.get(playout.arm.newest))
    """

    @property
    def name(self) -> str:
        """Return the name that scenarios use."""
        ...

    def initial(self) -> Any:
        """Return the state before the first arrival."""
        ...

    def step(self, state: Any, playout: Playout, now_ns: int) -> tuple[Any, Estimate]:
        """Return the new state and the estimate for one instant.

        Parameters
        ----------
        state
            The state that `initial` or the last step returned.
        playout
            The samples of command and arm that have arrived by ``now_ns``, by source index.
        now_ns
            The instant to estimate the position for: the tick's nominal instant in run time.

        Returns
        -------
        tuple
            The new state, and the `Estimate`; its covariance is that of the error at ``now_ns``, age included.
        """
        ...
