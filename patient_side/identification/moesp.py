"""Past-output MOESP: a state-space model from inputs and outputs (Verhaegen 1994, Automatica 30:61).

The rows [U_f; U_p; Y_p; Y_f] of all trials are reduced to one triangular factor L. Its block L32, the part
of the future outputs that the past explains beyond the future inputs, has the column space of the extended
observability matrix; A and C follow from its shift invariance, B, D and x0 from one least squares on the
outputs.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common.errors import DataError, Fault
from patient_side.identification.hankel import hankel_batches
from patient_side.identification.output_error import fit_inputs
from patient_side.identification.stability import stabilised
from patient_side.identification.trials import Scaling, Trial, check_trials
from patient_side.statespace import Array, StateSpace

_BATCH = 4096
_LARGE_CONDITION = 1e3
_NEGLIGIBLE = 1e-10


@dataclass(frozen=True)
class MoespResult:
    """A model, each trial's initial state (n,), the singular values (s p,) that show the order, and warnings.

    The singular values are those of outputs at unit deviation.
    """

    space: StateSpace
    x0: tuple[Array, ...]
    singular_values: Array
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class Subspace:
    """Left singular vectors (s p, s p) and values (s p,) of L32; ``rank`` of them exceed rounding."""

    left: Array
    singular_values: Array
    rank: int
    n_outputs: int


def identify_moesp(trials: Sequence[Trial], block_rows: int, order: int) -> MoespResult:
    """Return the model of ``order`` states from trials of inputs (N, m) and outputs (N, p); 0 is y = D u.

    Nothing is centred here, and the trials are not modified. Raises `DataError` for arrays that
    `check_trials` refuses, for inputs that do not excite all directions and for an order above (s - 1) p.
    Oracles in test_moesp: a known system's Markov parameters, SLICOT's published example.
    """
    check_trials(trials, block_rows)
    check_order(order, block_rows, trials[0][1].shape[1])
    scaling = Scaling.of(trials)
    scaled = scaling.scaled(trials)
    factor = triangular_factor(scaled, block_rows)
    n_inputs, n_outputs = trials[0][0].shape[1], trials[0][1].shape[1]
    warnings = check_excitation(factor, 2 * block_rows * n_inputs)
    found = subspace(factor, block_rows, n_inputs, n_outputs)
    space, x0, unstable = fit_order(found, order, scaled)
    return MoespResult(scaling.unscaled(space), x0, found.singular_values, (*warnings, *unstable))


def check_order(order: int, block_rows: int, n_outputs: int, smallest: int = 0) -> None:
    """Raise `DataError` when ``order`` is below ``smallest`` or ``block_rows`` block rows cannot show it."""
    largest = (block_rows - 1) * n_outputs
    if not smallest <= order <= largest:
        rule = f"must lie in {smallest}..{largest}, (block rows - 1) x outputs"
        raise DataError(Fault("identification", "order", rule, order))


def triangular_factor(trials: Sequence[Trial], block_rows: int, start: Array | None = None) -> Array:
    """Return the upper triangular L' of [U_f; U_p; Y_p; Y_f] = L Q over the columns of all trials.

    ``start`` is the factor of columns met before; no column crosses from one trial into the next.
    """
    n_inputs, n_outputs = trials[0][0].shape[1], trials[0][1].shape[1]
    factor = np.empty((0, 2 * block_rows * (n_inputs + n_outputs))) if start is None else start
    past = block_rows * n_inputs
    for u, y in trials:
        batches = zip(
            hankel_batches(u, 2 * block_rows, _BATCH), hankel_batches(y, 2 * block_rows, _BATCH), strict=True
        )
        for inputs, outputs in batches:
            rows = np.vstack([inputs[past:], inputs[:past], outputs]).T
            factor = np.asarray(np.linalg.qr(np.vstack([factor, rows]), mode="r"))
    return factor


def check_excitation(factor: Array, n_input_rows: int) -> tuple[str, ...]:
    """Return a warning when the inputs excite some direction weakly; raise `DataError` when not at all.

    ``factor`` is triangular, the inputs' Hankel rows first: ``n_input_rows`` of them.
    """
    n = n_input_rows
    values = np.linalg.svd(factor[:n, :n], compute_uv=False)
    rank = int(np.count_nonzero(values > _NEGLIGIBLE * values[0]))
    if rank < n:
        rule = f"must be persistently exciting: its Hankel matrix has rank {rank} of {n}"
        raise DataError(Fault("identification", "input", rule))
    condition = float(values[0] / values[-1])
    if condition <= _LARGE_CONDITION:
        return ()
    return (
        f"the input excites some directions weakly: condition {condition:.2g} of its Hankel matrix,"
        f" above {_LARGE_CONDITION:.0e}",
    )


def subspace(factor: Array, block_rows: int, n_inputs: int, n_outputs: int) -> Subspace:
    """Return the column space of L32 from `triangular_factor`'s result."""
    first, second = 2 * block_rows * n_inputs - block_rows * n_inputs, block_rows * (2 * n_inputs + n_outputs)
    future = factor[:, second:].T
    left, values, _ = np.linalg.svd(future[:, first:second])
    rank = int(np.count_nonzero(values > _NEGLIGIBLE * np.linalg.norm(future)))
    return Subspace(left, values, rank, n_outputs)


def fit_order(
    found: Subspace, order: int, trials: Sequence[Trial]
) -> tuple[StateSpace, tuple[Array, ...], tuple[str, ...]]:
    """Return the model of ``order`` states, each trial's x0, and what was done to make it stable."""
    p = found.n_outputs
    observability = found.left[:, :order]
    A = np.asarray(np.linalg.lstsq(observability[:-p], observability[p:])[0]) if order else np.empty((0, 0))
    C = np.ascontiguousarray(observability[:p])
    A, radius = stabilised(A)
    B, D, x0 = fit_inputs(A, C, trials)
    if radius < 1:
        return StateSpace(A, B, C, D), x0, ()
    warning = (
        f"the model of order {order} was unstable, spectral radius {radius:.6g}: its eigenvalues were moved"
        " inside the unit circle and B, D and x0 fitted to that"
    )
    return StateSpace(A, B, C, D), x0, (warning,)
