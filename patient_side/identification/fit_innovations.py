"""The arm's own movement from its training rows: stochastic MOESP, its order and its level's drift by validation."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from patient_side.identification.forecast_error import HeldBack
from patient_side.identification.innovations_form import InnovationsForm
from patient_side.identification.level_and_scale import Tried, clearly_better, try_model, with_level_and_scale
from patient_side.identification.noise import floored
from patient_side.identification.stochastic_moesp import (
    StochasticSubspace,
    check_order,
    check_outputs,
    n_hankel_columns,
    output_factor,
    realise,
    stochastic_subspace,
)
from patient_side.identification.trials import Scaling, Trial, n_first
from patient_side.identification.validation import HELD_BACK
from patient_side.innovations_filter import AXES
from patient_side.statespace import Array, InnovationsModel

ORDERS = (4, 6, 8, 10, 12, 14, 16, 20, 24, 30)

_FIRST_LEVEL_STEP = 0.1
_SUFFICIENT = 1.003
_STILL = 1e-3


@dataclass(frozen=True)
class FittedInnovations:
    """A model of all training rows, and what was found on the way.

    ``errors`` holds, by order, the error of forecasts of the held-back rows over that of holding, for models about a
    level; ``integrated_errors`` the same for models of increments; ``level_errors`` the same by the level's step, at
    the order chosen.
    """

    model: InnovationsModel
    errors: dict[int, float]
    integrated_errors: dict[int, float]
    level_errors: dict[float, float]
    warnings: tuple[str, ...]


def fit_innovations(
    trials: Sequence[Trial],
    rate_hz: int,
    block_rows: int,
    order: int | None = None,
    labels: Sequence[str] | None = None,
) -> FittedInnovations:
    """Return the innovations model of the outputs (N, 3), in m, of one or several trials; inputs play no part.

    Both structures are tried, on the last 30 % of every trial's rows, in models of the rows before: positions, each
    trial about its own mean, and increments. The criterion is the geometric mean, over trials and 33, 100, 200, 500
    and 1000 ms, of the error over that of holding; the order is the smallest within 0.3 % of the best. Positions have
    to be better than increments by more than two standard errors: that an arm comes back to where it mostly is takes
    more to be seen than one short trial, whose rows always come back to their own mean. The model itself is then one
    of all rows. Trials are weighted as least squares asks for, by the inverse size of their innovations: else the
    liveliest outvotes the others. Raises `DataError` for arrays that `check_outputs` refuses, or an ``order`` that
    cannot be shown. Oracle: a known system's forecasts, test_fit_innovations.
    """
    outputs = [y for _, y in trials]
    check_outputs(outputs, block_rows, labels, HELD_BACK)
    if order is not None:
        check_order(order, block_rows, AXES)
    sizes = _innovation_sizes(outputs)
    cuts = [n_first(len(y), HELD_BACK) for y in outputs]
    held_back = HeldBack(tuple(y - y.mean(axis=0) for y in outputs), tuple(cuts))
    about_level = _Structure.of(held_back.outputs, cuts, sizes, block_rows, integrated=False)
    increments = [np.diff(y, axis=0) for y in outputs]
    integrated = _Structure.of(increments, [cut - 1 for cut in cuts], sizes, block_rows, integrated=True)

    tried = [each.try_orders(held_back, rate_hz, order) for each in (about_level, integrated)]
    chosen = [_smallest_sufficient(errors) for errors in tried]
    best = [errors[n] for errors, n in zip(tried, chosen, strict=True)]
    structure = about_level if clearly_better(best[0], best[1], held_back.outputs, rate_hz) else integrated
    at = chosen[structure.integrated]
    form, warnings = realise(structure.found, at)
    model, level_errors = with_level_and_scale(structure.model(form), structure.of_first(at), held_back, rate_hz)
    errors = [{n: each.error for n, each in by_order.items()} for by_order in tried]
    return FittedInnovations(model, errors[0], errors[1], level_errors, warnings)


@dataclass(frozen=True)
class _Structure:
    """The subspaces of positions, or increments, of the first rows and of all rows, and the unit they are in, m."""

    on_first: StochasticSubspace
    found: StochasticSubspace
    scale: Array
    integrated: bool

    @classmethod
    def of(
        cls,
        signals: Sequence[Array],
        cuts: Sequence[int],
        sizes: Sequence[float],
        block_rows: int,
        *,
        integrated: bool,
    ) -> "_Structure":
        even = [signal / size for signal, size in zip(signals, sizes, strict=True)]
        scale = Scaling.of([(signal, signal) for signal in even]).output
        on_first, found = _subspaces([signal / scale for signal in even], cuts, block_rows)
        # so that the innovations are of the size that they have on average
        return cls(on_first, found, scale * float(np.sqrt(np.mean(np.square(sizes)))), integrated)

    def model(self, form: InnovationsForm) -> InnovationsModel:
        form = form.in_units(self.scale)
        return InnovationsModel(
            A=form.A,
            C=form.C,
            K=form.K,
            Re=floored(form.Re),
            level_step=_FIRST_LEVEL_STEP,
            block_rows=len(self.found.left) // self.found.n_outputs,
            singular_values=self.found.singular_values,
            scale_horizons=np.ones(1),
            covariance_scale=np.ones(1),
            integrated=self.integrated,
        )

    def of_first(self, order: int) -> InnovationsModel:
        return self.model(realise(self.on_first, order)[0])

    def try_orders(self, held_back: HeldBack, rate_hz: int, order: int | None) -> dict[int, Tried]:
        largest = min(self.on_first.rank, len(self.found.left) - self.found.n_outputs)
        orders = [n for n in ORDERS if n <= largest] or [largest]
        return {n: try_model(self.of_first(n), held_back, rate_hz) for n in ([order] if order else orders)}


def _smallest_sufficient(tried: dict[int, Tried]) -> int:
    best = min(each.error for each in tried.values())
    return next(n for n, each in tried.items() if each.error <= _SUFFICIENT * best)


def _innovation_sizes(outputs: Sequence[Array]) -> list[float]:
    """Return how large each trial's innovations are, but for a common factor: rms of its second differences."""
    sizes = [float(np.sqrt(np.mean(np.square(np.diff(y, n=2, axis=0))))) for y in outputs]
    typical = max(sizes)
    return [size if size > _STILL * typical else typical for size in sizes]


def _subspaces(
    scaled: Sequence[Array], cuts: Sequence[int], block_rows: int
) -> tuple[StochasticSubspace, StochasticSubspace]:
    """Return the subspaces of the first rows and of all rows; the second factor continues the first."""
    head = [y[:cut] for y, cut in zip(scaled, cuts, strict=True)]
    first = output_factor(head, block_rows)
    on_first = stochastic_subspace(first.copy(), block_rows, n_hankel_columns(head, block_rows))
    # the columns not met yet begin where the last one of the first rows began, plus one
    rest = [y[max(0, cut - 2 * block_rows + 1) :] for y, cut in zip(scaled, cuts, strict=True)]
    factor = output_factor(rest, block_rows, first)
    return on_first, stochastic_subspace(factor, block_rows, n_hankel_columns(scaled, block_rows))
