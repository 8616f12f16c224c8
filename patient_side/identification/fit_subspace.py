"""A subspace method on a training set: order by a rule, x0, noise in innovations form, detection of a pure gain."""

from collections.abc import Sequence
from functools import partial

from tis.common.scenario.identification import Order
from tis.patient_side.identification.dataset import TrainingSet
from tis.patient_side.identification.fitted import Fitted
from tis.patient_side.identification.noise import arx_residuals, estimate_noise
from tis.patient_side.identification.order import Candidate, choose_order, is_static, largest_candidate
from tis.patient_side.identification.past_states import PastStates
from tis.patient_side.identification.subspace import (
    FutureBlocks,
    Method,
    Subspace,
    check_excitation,
    check_order,
    realise,
)
from tis.patient_side.identification.trials import Scaling, Trial, check_trials
from tis.patient_side.identification.triangular import triangular_factor
from tis.patient_side.identification.validation import HELD_BACK, simulation_fit, split_trials


def fit_subspace(training: TrainingSet, method: Method, block_rows: int, order: Order) -> Fitted:
    """Return the model identified by ``method``; raises `DataError` with all faults."""
    # Checks, scaling, and the subspaces of the first rows and of all rows.
    n_start = 2 * block_rows
    check_trials(training.trials, block_rows, training.labels, HELD_BACK)
    scaling = Scaling.of(training.trials)
    scaled = scaling.scaled(training.trials)
    fit_on, validate_on = split_trials(scaled)
    (found_on_first, states_on_first), (found, states), warnings = _subspaces(scaled, fit_on, method, block_rows)
    if isinstance(order, int):
        check_order(order, block_rows, found.n_outputs, shown=len(found.singular_values))

    # The order: a model of the first rows for each, compared on the last rows.
    largest = largest_candidate(found_on_first.rank, block_rows, found.n_outputs)
    residuals = arx_residuals(fit_on, block_rows)
    on_first = partial(realise, found_on_first, states_on_first, trials=fit_on, block_rows=block_rows)
    fitted = [on_first(order=n, residuals=residuals) for n in range(largest + 1)]
    candidates = [
        each.candidate or Candidate.of(each.space, each.x0, fit_on, block_rows, residuals) for each in fitted
    ]
    n_fitted = sum(len(u) for u, _ in fit_on)
    orders = choose_order(candidates, n_fitted, validate_on, found.singular_values, n_start)
    chosen = orders.by_rule(order)
    first_rows = (fitted[chosen] if chosen <= largest else on_first(order=chosen, residuals=residuals)).space
    fit = simulation_fit(first_rows, validate_on, n_start)

    # The model of all rows with its noise.
    realised = realise(found, states, chosen, scaled, block_rows)
    space = scaling.unscaled(realised.space)
    noise, no_gain = estimate_noise(space, realised.x0, training.trials, block_rows)
    static = is_static(chosen, fit)
    if static:
        warnings = ()  # a gain needs no excitation over time, only movement in every direction
    return Fitted(
        space=space,
        x0=realised.x0[0],
        noise=noise,
        singular_values=found.singular_values,
        orders=orders,
        first_rows=scaling.unscaled(first_rows),
        fit=fit,
        n_start=n_start,
        static=static,
        warnings=(*warnings, *realised.warnings, *no_gain),
    )


def _subspaces(
    trials: Sequence[Trial], fit_on: Sequence[Trial], method: Method, block_rows: int
) -> tuple[tuple[Subspace, PastStates], tuple[Subspace, PastStates], tuple[str, ...]]:
    """Return subspace and states of the first rows and of all rows; the second factor continues the first."""
    n_inputs, n_outputs = trials[0][0].shape[1], trials[0][1].shape[1]
    first = triangular_factor(fit_on, block_rows)
    window = 2 * block_rows
    # The remaining columns begin one row after the last column of the first rows.
    rest = [
        (u[max(0, len(head) - window + 1) :], y[max(0, len(head) - window + 1) :])
        for (u, y), (head, _) in zip(trials, fit_on, strict=True)
    ]
    factor = triangular_factor(rest, block_rows, first)
    warnings = check_excitation(factor, window * n_inputs)
    on_first, on_all = (
        (
            method(FutureBlocks.of(each, block_rows, n_inputs, n_outputs)),
            PastStates.of(each, block_rows, n_inputs, n_outputs),
        )
        for each in (first, factor)
    )
    return on_first, on_all, warnings
