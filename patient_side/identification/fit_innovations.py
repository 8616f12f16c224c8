"""The arm's own movement from its training rows: stochastic MOESP, its structure, order and drift by validation."""

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
"""States an axis of a model that is the same in every direction."""

_SUFFICIENT = 1.003


@dataclass(frozen=True)
class FittedInnovations:
    """A model of all training rows, and what was found on the way.

    ``errors`` holds, by structure and order, the error of forecasts of the held-back rows over that of holding.
    """

    model: InnovationsModel
    errors: dict[Structure, dict[int, float]]
    warnings: tuple[str, ...]

    @property
    def structure(self) -> Structure:
        """Return the structure chosen."""
        return Structure(isotropic=self.model.isotropic, integrated=self.model.integrated)


def fit_innovations(
    trials: Sequence[Trial],
    rate_hz: int,
    block_rows: int,
    order: int | None = None,
    grippers_rad: Sequence[Array] = (),
) -> FittedInnovations:
    """Return the innovations model of the outputs (N, 3), in m, of one or several trials; inputs play no part.

    Four structures are tried, on the last 30 % of every trial's rows, in models of the rows before: positions, each
    trial about its own mean, and increments; with one movement for every direction (`isotropic`), and free. The
    criterion is the geometric mean, over trials and 33, 100, 200, 500 and 1000 ms, of the error over that of holding;
    a structure's order is the smallest within 0.3 % of its best. The structure is the first of `PREFERRED` but where
    another is `clearly_better`; then the best of those. The model itself is then one of all rows, an
    isotropic one with what the phase of a reach tells (`fit_reach`), to which the grippers' angles (N,) belong where
    they are given. Trials are weighted
    as least squares asks for, by the inverse size of their innovations: else the liveliest outvotes the others. With
    an ``order`` the structures that can have it are tried. Raises `DataError` for arrays that `check_outputs`
    refuses, or an ``order`` that cannot be shown. Oracle: a known system's forecasts, test_fit_innovations.
    """
    outputs = [y for _, y in trials]
    check_outputs(outputs, block_rows, HELD_BACK)
    if order is not None:
        check_order(order, block_rows, AXES)
    cuts = [n_first(len(y), HELD_BACK) for y in outputs]
    held_back = HeldBack(tuple(y - y.mean(axis=0) for y in outputs), tuple(cuts), tuple(grippers_rad))
    tried: dict[Structure, dict[int, Tried]] = {}
    subspaces: dict[Structure, StructuredSubspace] = {}
    for structure in PREFERRED:
        orders = _orders(structure, order)
        if orders:
            found = StructuredSubspace.of(structure, held_back.outputs, cuts, block_rows)
            subspaces[structure] = found
            tried[structure] = {n: try_model(found.of_first(n), held_back, rate_hz) for n in found.shown(orders)}
    chosen = {structure: _smallest_sufficient(by_order) for structure, by_order in tried.items()}
    structure = _structure({each: tried[each][n] for each, n in chosen.items()}, held_back, rate_hz)
    found, at = subspaces[structure], chosen[structure]
    model, warnings = found.of_all(at)
    model = with_level_and_scale(model, found.of_first(at), held_back, rate_hz, tried[structure][at])
    errors = {each: {n: by.error for n, by in by_order.items()} for each, by_order in tried.items()}
    return FittedInnovations(model, errors, warnings)


def _orders(structure: Structure, order: int | None) -> tuple[int, ...]:
    """Return the orders to try of a structure: none where it cannot have the one asked for."""
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
