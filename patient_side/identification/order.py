"""How many states: three rules that often disagree, all reported; ``auto`` takes the validated one."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from patient_side.identification.trials import Trial
from patient_side.identification.validation import SimulationFit, simulation_fit
from patient_side.statespace import Array, StateSpace

LARGEST_ORDER = 12
_ENERGY_SHARE = 0.85
_RELATIVE_TOLERANCE = 1.05
_ABSOLUTE_TOLERANCE = 0.01
_STATIC_FIT_PCT = 90.0


@dataclass(frozen=True)
class OrderChoice:
    """What each rule says. ``fits[n]`` is the fit of the model of n states on the held-back rows."""

    energy: int
    log_gap: int
    validation: int
    fits: tuple[SimulationFit, ...]


def is_static(order: int, fit: SimulationFit) -> bool:
    """Return whether a gain alone is the whole relation: no states, and 90 % of every axis explained."""
    return order == 0 and min(fit.fit_pct) >= _STATIC_FIT_PCT


def energy_order(singular_values: Array) -> int:
    """Return the fewest singular values whose sum is 85 % of all (the paper's rule); 0 if all are 0."""
    total = float(np.sum(singular_values))
    if total == 0:
        return 0
    return int(np.searchsorted(np.cumsum(singular_values), _ENERGY_SHARE * total)) + 1


def log_gap_order(singular_values: Array) -> int:
    """Return the order before the largest ratio of one singular value to the next; 0 when all are 0.

    Values below 1e-10 of the largest are rounding: they count as that bound, and gaps among them as none.
    """
    if len(singular_values) < 2 or singular_values[0] == 0:
        return 0
    logs = np.log(np.maximum(singular_values, 1e-10 * singular_values[0]))
    return int(np.argmax(logs[:-1] - logs[1:])) + 1


def largest_candidate(rank: int, block_rows: int, n_outputs: int) -> int:
    """Return the largest order worth fitting: what rank, shift and `LARGEST_ORDER` allow."""
    return min(LARGEST_ORDER, rank, (block_rows - 1) * n_outputs)


def choose_order(
    candidates: Sequence[StateSpace], validate_on: Sequence[Trial], singular_values: Array, n_start: int
) -> OrderChoice:
    """Simulate the last rows with every candidate, and let all rules speak.

    ``candidates[n]`` has n states and is fitted to the first rows, in the units of ``validate_on``;
    ``singular_values`` are those of all rows; simulations begin as `simulation_fit` says. The validated order is
    the smallest one whose simulation error lies within 5 % of the smallest error, or within 1 % of the signal's
    deviation of it: less is not worth a state.
    """
    fits = [simulation_fit(space, validate_on, n_start) for space in candidates]
    return OrderChoice(
        energy_order(singular_values), log_gap_order(singular_values), smallest_sufficient(fits), tuple(fits)
    )


def smallest_sufficient(fits: Sequence[SimulationFit]) -> int:
    """Return the smallest order whose error is as good as the best one's, within the tolerances."""
    best = min(fit.error for fit in fits)
    bound = max(_RELATIVE_TOLERANCE * best, best + _ABSOLUTE_TOLERANCE)
    return next(order for order, fit in enumerate(fits) if fit.error <= bound)
