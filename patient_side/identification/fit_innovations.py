"""The arm's own movement by stochastic MOESP: structure, order and drift by validation."""

from collections.abc import Sequence
from dataclasses import dataclass

from patient_side.filters.innovations_filter import AXES
from patient_side.identification.forecast_error import HeldBack
from patient_side.identification.level_and_scale import Tried, clearly_better, try_model, with_level_and_scale
from patient_side.identification.stochastic_moesp import check_order, check_outputs
from patient_side.identification.structure import PREFERRED, Structure, StructuredSubspace
from patient_side.identification.trials import Trial, n_first
from patient_side.identification.validation import HELD_BACK
from patient_side.statespace import Array, InnovationsModel

ORDERS = (4, 6, 8, 10, 12, 14, 16, 20, 24, 30)
AXIS_ORDERS = (2, 3, 4, 5, 6, 7, 8, 10)
"""States per axis of an isotropic model."""

_SUFFICIENT = 1.003


@dataclass(frozen=True)
class FittedInnovations:
    """A model of all training rows, and the results of the selection.

    ``errors`` holds, by structure and order, the error of forecasts of the held-back rows over that of hold.
    """

    model: InnovationsModel
    errors: dict[Structure, dict[int, float]]
    warnings: tuple[str, ...]


def fit_innovations(
    trials: Sequence[Trial],
    rate_hz: int,
    block_rows: int,
    order: int | None = None,
    grippers_rad: Sequence[Array] = (),
) -> FittedInnovations:
    """Return the innovations model of the outputs (N, 3), in m, of one or several trials; inputs are not used.

    Four structures are compared on the last 30 % of every trial's rows, with models of the rows before: positions,
    each trial about its own mean, or increments; isotropic or free. The criterion is the geometric mean, over trials
    and 33, 100, 200, 500 and 1000 ms, of the error over that of hold; a structure's order is the smallest within
    0.3 % of its best. The structure is the first of `PREFERRED`, unless others are `clearly_better`: then the best of
    those. The final model is fitted to all rows, an isotropic one with the phase of a reach (`fit_reach`) and, where
    given, the grippers' angles (N,). Trials are weighted by the inverse size of their innovations, as weighted least
    squares requires: otherwise the liveliest trial dominates. With an ``order`` only the structures that can have it
    are tried. Raises `DataError` for arrays that `check_outputs` rejects, or for an ``order`` beyond the block rows.
    Oracle: a known system's forecasts, test_fit_innovations.
    """
    # Checks, and the rows held back.
    outputs = [y for _, y in trials]
    check_outputs(outputs, block_rows, HELD_BACK)
    if order is not None:
        check_order(order, block_rows, AXES)
    cuts = [n_first(len(y), HELD_BACK) for y in outputs]
    held_back = HeldBack(tuple(y - y.mean(axis=0) for y in outputs), tuple(cuts), tuple(grippers_rad))
    # Every structure and order on the first rows.
    tried: dict[Structure, dict[int, Tried]] = {}
    subspaces: dict[Structure, StructuredSubspace] = {}
    for structure in PREFERRED:
        orders = _orders(structure, order)
        if orders:
            found = StructuredSubspace.of(structure, held_back.outputs, cuts, block_rows)
            subspaces[structure] = found
            tried[structure] = {n: try_model(found.of_first(n), held_back, rate_hz) for n in found.shown(orders)}
    # Selection, and the model of all rows.
    chosen = {structure: _smallest_sufficient(by_order) for structure, by_order in tried.items()}
    structure = _structure({each: tried[each][n] for each, n in chosen.items()}, held_back, rate_hz)
    found, at = subspaces[structure], chosen[structure]
    model, warnings = found.of_all(at)
    model = with_level_and_scale(model, found.of_first(at), held_back, rate_hz, tried[structure][at])
    errors = {each: {n: by.error for n, by in by_order.items()} for each, by_order in tried.items()}
    return FittedInnovations(model, errors, warnings)


def _orders(structure: Structure, order: int | None) -> tuple[int, ...]:
    """Return the orders to try of a structure: none where it cannot have the requested one."""
    if order is not None:
        return () if structure.isotropic and order % AXES else (order,)
    return tuple(AXES * n for n in AXIS_ORDERS) if structure.isotropic else ORDERS


def _smallest_sufficient(tried: dict[int, Tried]) -> int:
    best = min(each.error for each in tried.values())
    return next(n for n, each in tried.items() if each.error <= _SUFFICIENT * best)


def _structure(tried: dict[Structure, Tried], held_back: HeldBack, rate_hz: int) -> Structure:
    preferred = next(iter(tried))
    others = [each for each in tried if each != preferred]
    better = [each for each in others if clearly_better(tried[each], tried[preferred], held_back, rate_hz)]
    return min(better, key=lambda each: tried[each].error, default=preferred)
