"""Joint states of a fit: delay and loss that change together."""

from math import sqrt
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Direction
from tis.common.units import NS_PER_MS
from tis.netem.fit.loss_chain import loss_stage
from tis.netem.fit.marginal import quantile_table

_ALWAYS: Final = 0.98
_CERTAIN: Final = 3.0
_MIN_DELAYS: Final = 5
_ALIKE: Final = 1.2
_NOTICED: Final = 0.1
_TOLERANCE: Final = 0.03


class FittedState(NamedTuple):
    """One state: its ``name``, the fields of its duration and succession, and what it changes in a pipeline."""

    name: str
    duration: dict[str, Any]
    change: dict[str, Any]


class JointStates(NamedTuple):
    """The states of one direction; ``kind`` is ``markov`` or ``cycle``, ``note`` describes how they were found."""

    kind: str
    states: tuple[FittedState, ...]
    note: str

    def network(self, *directions: Direction) -> dict[str, Any]:
        """Return the states as in a network, with the same change in each of ``directions``."""
        return {
            "kind": self.kind,
            "states": [
                {"name": state.name, **state.duration}
                | (dict.fromkeys(directions, state.change) if state.change else {})
                for state in self.states
            ],
        }


def change_of(delay_ns: NDArray[np.int64], in_base_ns: NDArray[np.int64]) -> dict[str, Any]:
    """Return what a state changes in the pipeline of the base state, from the messages of both.

    ``delay_ns`` (n,) and ``in_base_ns`` (m,) are negative where lost. A delay that is only shifted becomes
    ``add_delay_ms``; one that has another spread becomes a table of quantiles.
    """
    lost, lost_in_base = delay_ns < 0, in_base_ns < 0
    if len(lost) and lost.mean() > _ALWAYS:
        return {"outage": True}
    change: dict[str, Any] = {}
    expected = float(lost_in_base.mean()) * len(lost)
    if abs(int(lost.sum()) - expected) > _CERTAIN * sqrt(expected + 1):
        change["loss"] = loss_stage(lost) or {"kind": "bernoulli", "p_loss": 0.0}
    there, base = delay_ns[~lost] / NS_PER_MS, in_base_ns[~lost_in_base] / NS_PER_MS
    if len(there) < _MIN_DELAYS or not len(base):
        return change
    more, spread, of_spread = float(there.mean() - base.mean()), float(there.std()), float(base.std())
    alike = of_spread / _ALIKE <= spread <= of_spread * _ALIKE
    if alike and abs(more) <= _NOTICED * of_spread:
        return change
    if alike and more > 0:
        return {**change, "add_delay_ms": float(f"{more:.4g}")}
    return {**change, "delay": quantile_table(delay_ns[~lost], _TOLERANCE).stage(6)}


def earlier(change: dict[str, Any], by_ms: float) -> dict[str, Any]:
    """Return a change with delays that are ``by_ms`` shorter, and not below the shortest of its table."""
    if "add_delay_ms" in change:
        return {**change, "add_delay_ms": float(f"{max(change['add_delay_ms'] - by_ms, 0.0):.4g}")}
    if change.get("delay", {}).get("kind") != "quantiles":
        return change
    points = change["delay"]["points"]
    least_ms = points[0]["delay_ms"]
    shorter = [{**point, "delay_ms": float(f"{max(point['delay_ms'] - by_ms, least_ms):.6g}")} for point in points]
    return {**change, "delay": {"kind": "quantiles", "points": shorter}}
