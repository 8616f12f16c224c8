"""The subspace methods MOESP, past-input MOESP, N4SID and CVA, all linear methods by name, and their use in training.

A subspace method finds the column space of the extended observability matrix in blocks of the triangular factor; what
follows is common to all, see `subspace`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import MappingProxyType

import numpy as np

from tis.common.order_rules import Order
from tis.patient_side.identification import arx
from tis.patient_side.identification.hankel import triangular_factor
from tis.patient_side.identification.linear_model import LinearModel
from tis.patient_side.identification.noise import arx_residuals
from tis.patient_side.identification.order import (
    NEGLIGIBLE_ERROR,
    NO_ERROR,
    Candidate,
    Fitted,
    choose_order,
    is_static,
    largest_candidate,
)
from tis.patient_side.identification.subspace import (
    FutureBlocks,
    Method,
    PastStates,
    Subspace,
    check_excitation,
    check_order,
    column_space,
    identify_subspace,
    noise_of,
    realise,
)
from tis.patient_side.identification.trials import Scaling, Trial, check_trials
from tis.patient_side.identification.validation import HELD_BACK, simulation_fit, split_trials

_RELATIVE_FLOOR = 1e-8


def moesp_subspace(blocks: FutureBlocks) -> Subspace:
    """Return the column space of L32, with no weighting on the outputs.

    Past-output MOESP (Verhaegen 1994, Automatica 30:61): past inputs and outputs as instruments.
    The block L32 of the factor, the part of the future outputs that the past explains beyond the future inputs, has
    the column space of the extended observability matrix; it is consistent under white process and measurement noise.

    Oracles in test_moesp: a known system's Markov parameters, SLICOT's published example.
    """
    return column_space(blocks.by_past, blocks.scale, blocks.n_outputs)


def pi_moesp_subspace(blocks: FutureBlocks) -> Subspace:
    """Return the column space of the part that past inputs explain beyond the future ones.

    Past-input MOESP (Verhaegen 1993, Int. J. Control 58:555): past inputs alone as instruments.
    Past outputs contain noise, and where that is coloured they are correlated with the future noise: `moesp` and
    `n4sid` then converge to wrong poles however long the data. Past inputs are uncorrelated with it, as long as there
    is no feedback from outputs to inputs. The price is variance: modes that only noise excites are invisible.

    An order above s m is rejected. Oracle in test_subspace_methods: coloured noise.
    """
    found = column_space(blocks.by_past_inputs, blocks.scale, blocks.n_outputs)
    return replace(found, uses_outputs=False)


def n4sid_subspace(blocks: FutureBlocks) -> Subspace:
    """Return the column space of the oblique projection, in the directions of [U_f; U_p; Y_p].

    N4SID (Van Overschee and De Moor 1994, Automatica 30:75): the oblique projection, unweighted.
    The future outputs are projected on the past along the future inputs: ``Y_f = H_p W_p + H_f U_f + rest`` by least
    squares, and the part ``H_p W_p = Gamma X`` is the extended observability matrix times a sequence of states. MOESP
    uses the same ``H_p W_p`` with the future inputs projected out of its rows (a weighting on the right).

    Oracle in test_subspace_methods: the projection over all columns by its definition.
    """
    n_new = blocks.by_past.shape[1]
    # lstsq: without noise the past outputs depend linearly on the rest, and the triangle is singular.
    onto_past = np.linalg.lstsq(blocks.past[:, -n_new:].T, blocks.by_past.T)[0].T
    return column_space(onto_past @ blocks.past, blocks.scale, blocks.n_outputs)


def cva_subspace(blocks: FutureBlocks) -> Subspace:
    """Return the directions by canonical correlation, carried back to the outputs and made orthonormal again.

    Canonical variate analysis (Larimore 1990): directions of the future ranked by their predictability.
    The column space of `moesp` with whitened future outputs: the singular values are the canonical correlations of
    past and future given the future inputs, 0..1, so that a direction ranks by its predictable share and not by its
    size. Of the subspace weightings it has the least variance for white inputs and noise.

    Directions of the outputs, given the future inputs, below 1e-8 of the largest are not amplified by the whitening.

    Oracle in test_subspace_methods: canonical correlations by their definition.
    """
    given_inputs = np.hstack([blocks.by_past, blocks.unexplained])
    directions, sizes, _ = np.linalg.svd(given_inputs, full_matrices=False)
    sizes = np.maximum(sizes, _RELATIVE_FLOOR * blocks.scale)
    whitened = column_space((directions.T @ blocks.by_past) / sizes[:, None], 1.0, blocks.n_outputs)
    back, _ = np.linalg.qr(directions @ (sizes[:, None] * whitened.left))
    return Subspace(back, whitened.singular_values, whitened.rank, blocks.n_outputs)


SUBSPACE_METHODS: Mapping[str, Method] = MappingProxyType(
    {"moesp": moesp_subspace, "pi_moesp": pi_moesp_subspace, "n4sid": n4sid_subspace, "cva": cva_subspace}
)

METHODS: Mapping[str, Callable[..., LinearModel]] = MappingProxyType(
    {
        **{name: partial(identify_subspace, name, method) for name, method in SUBSPACE_METHODS.items()},
        "arx": arx.identify,
    }
)
"""Each takes ``(u, y, order, horizon, stable=True)``: see `identify_subspace`."""


def fit_subspace(
    trials: Sequence[Trial],
    labels: Sequence[str],
    method: Method,
    block_rows: int,
    order: Order,
    *,
    stable: bool = True,
) -> Fitted:
    """Return the model identified by ``method``; raises `DataError` with all faults.

    ``stable``: unstable poles are moved inside; else they stay, and B, D, x0 and K are those of the filter.
    """
    # Checks, scaling, and the subspaces of the first rows and of all rows.
    n_start = 2 * block_rows
    check_trials(trials, block_rows, labels, HELD_BACK, fewest_inputs=0)
    scaling = Scaling.of(trials)
    scaled = scaling.scaled(trials)
    fit_on, validate_on = split_trials(scaled)
    (found_on_first, states_on_first), (found, states), warnings = _subspaces(scaled, fit_on, method, block_rows)
    if isinstance(order, int):
        check_order(order, block_rows, found.n_outputs, shown=len(found.singular_values))

    # The order: a model of the first rows for each, compared on the last rows.
    largest = largest_candidate(found_on_first.rank, block_rows, found.n_outputs)
    residuals = arx_residuals(fit_on, block_rows)
    on_first = partial(realise, found_on_first, states_on_first, trials=fit_on, block_rows=block_rows, stable=stable)
    fitted = [on_first(order=n, residuals=residuals) for n in range(largest + 1)]
    candidates = [
        each.candidate or Candidate.of(each.space, each.x0, fit_on, block_rows, residuals) for each in fitted
    ]
    n_fitted = sum(len(u) for u, _ in fit_on)
    negligible = NEGLIGIBLE_ERROR if stable else NO_ERROR
    orders = choose_order(candidates, n_fitted, validate_on, found.singular_values, n_start, negligible)
    chosen = orders.by_rule(order)
    first_rows = (fitted[chosen] if chosen <= largest else on_first(order=chosen, residuals=residuals)).space
    fit = simulation_fit(first_rows, validate_on, n_start)

    # The model of all rows with its noise.
    realised = realise(found, states, chosen, scaled, block_rows, stable=stable)
    space = scaling.unscaled(realised.space)
    noise, no_gain = noise_of(realised, scaling, trials, block_rows, stable=stable)
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
