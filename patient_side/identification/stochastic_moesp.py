"""Stochastic MOESP: a model of outputs without inputs, from outputs alone.

The rows [Y_p; Y_f] of all trials are reduced to one triangular factor. Its block L21, the part of the future outputs
that the past ones explain as instruments, has the column space of the extended observability matrix G (Verhaegen and
Verdult, "Filtering and System Identification", 9.6, without inputs). The state at an instant is then the prediction
of the future from the s outputs before it, ``x[k] = G^+ E(y_f | y_p)``: a fixed combination of these outputs. A and C
are the regression of x[k+1] and y[k] on x[k], the noise covariances are those of its residuals, and the Kalman gain
follows from them (Larimore 1990, "Canonical variate analysis in identification, filtering and adaptive control"; Van
Overschee and De Moor, "Subspace Identification for Linear Systems", 3.4).

Both states of the regression are the same combination of outputs, one sample apart. Except for the trials' ends they
therefore have the same covariance, and A is a contraction in it: stable, which the shift of G often is not. The
residuals' covariances are positive semidefinite by construction, so the Riccati equation has a solution.

The innovations form of a stochastic model: its Kalman gain, from a discrete algebraic Riccati equation.

For ``x[k+1] = A x[k] + w[k]``, ``y[k] = C x[k] + v[k]`` with the joint covariance [Q S; S' R] of w and v, the
stationary one-step predictor has innovations e of covariance Re and the gain K:

    P = A P A' + Q - K Re K',   Re = C P C' + R,   K = (A P C' + S) Re^-1

and ``x[k+1] = A x[k] + K e[k]``, ``y[k] = C x[k] + e[k]`` has the same second moments (Anderson and Moore, *Optimal
Filtering*, 9.3). The cross term S must not be dropped.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tis.common.errors import DataError, Fault
from tis.patient_side.identification.hankel import COLUMNS_AT_ONCE, accumulate, empty_factor, fill_hankel
from tis.patient_side.identification.linear_model import LinearModel, Provenance, Signals, as_arrays, check_numbers
from tis.patient_side.identification.output_error import STABLE_BELOW, stabilised
from tis.patient_side.identification.trials import Scaling, breakdown_as_fault, check_trials, n_first
from tis.patient_side.identification.validation import initial_state
from tis.patient_side.linear_system import Array, NoiseModel, StateSpace

_MAX_DOUBLINGS = 60
_CONVERGED = 1e-15


@dataclass(frozen=True)
class InnovationsForm:
    """``x[k+1] = A x[k] + K e[k]``, ``y[k] = C x[k] + e[k]`` with the covariance ``Re`` of e."""

    A: Array
    C: Array
    K: Array
    Re: Array

    def in_units(self, scale: Array) -> "InnovationsForm":
        """Return the same model of outputs multiplied by ``scale`` (p,)."""
        out = scale[:, None]
        return InnovationsForm(self.A, out * self.C, self.K / scale, out * self.Re * scale)


def innovations_form(A: Array, C: Array, Q: Array, R: Array, S: Array) -> InnovationsForm:
    """Return the innovations form for noises of covariances Q (n, n), R (p, p) > 0 and cross term S (n, p).

    A - K C is stable where A is. Oracles in test_innovations_form: scipy's solver on the eigenvalues of a pencil, and
    Kalman's recursion.
    """
    P = filter_riccati(A, C, Q, R, S)
    Re = C @ P @ C.T + R
    Re = (Re + Re.T) / 2
    K = np.linalg.solve(Re, (A @ P @ C.T + S).T).T
    return InnovationsForm(A, C, np.asarray(K), Re)


def filter_riccati(A: Array, C: Array, Q: Array, R: Array, S: Array) -> Array:
    """Return the stabilising solution P (n, n) of the filter's Riccati equation, cross term included.

    Given y, the noise of the transition ``A - T C``, ``T = S R^-1``, is ``Q - T S'`` and independent of v; the
    remaining equation is solved by doubling: every step covers twice as many samples (Anderson 1978, Int. J. Control
    28:295). Unlike methods on eigenvalues it stays accurate with modes close to the unit circle.
    """
    n = len(A)
    T = np.linalg.solve(R, S.T).T
    a, h = (A - T @ C).T, Q - T @ S.T
    g = C.T @ np.linalg.solve(R, C)
    h = (h + h.T) / 2
    for _ in range(_MAX_DOUBLINGS):
        through = np.linalg.solve(np.eye(n) + g @ h, np.hstack([a, g]))
        step = a.T @ h @ through[:, :n]
        g = g + a @ through[:, n:] @ a.T
        a = a @ through[:, :n]
        h = h + step
        g, h = (g + g.T) / 2, (h + h.T) / 2
        if np.max(np.abs(step), initial=0.0) <= _CONVERGED * np.max(np.abs(h), initial=0.0):
            break
    return np.asarray(h)


_NEGLIGIBLE = 1e-10
_RESOLVED = 1e-18
"""Minimum variance of a residual, relative to the outputs': far below the resolution of any recording."""

_INVERTIBLE = 1e-13
"""Minimum variance of a residual in one direction, relative to all: below it double precision has no inverse."""


@dataclass(frozen=True)
class StochasticSubspace:
    """The past's prediction of the future: left singular vectors (s p, s p) and values (s p,) of L21.

    ``factor`` (2 s p, 2 s p) is the triangle of [Y_p; Y_f] over ``n_columns`` columns, ``predictor`` (s p, s p) the
    regression of Y_f on Y_p; ``rank`` singular values exceed rounding.
    """

    factor: Array
    predictor: Array
    left: Array
    singular_values: Array
    rank: int
    n_columns: int
    n_outputs: int


@breakdown_as_fault("stochastic_moesp")
def identify(u: Signals | None, y: Signals, order: int, horizon: int) -> LinearModel:  # noqa: ARG001  one call shape
    """Return the model of ``order`` states of outputs (N, p), one trial or several; inputs are ignored.

    B and D have no columns. ``horizon`` is the number of block rows of past and future each. Nothing is centred.
    Raises `DataError` for arrays that `check_trials` rejects and for orders outside 1 .. (horizon - 1) p. Oracles in
    test_stochastic_moesp: known systems' eigenvalues, Markov parameters and innovations.
    """
    # Checks, scaling, and the subspace.
    check_numbers(order, horizon)
    outputs = as_arrays("output", y)
    trials = [(out[:, :0] if out.ndim == 2 else out, out) for out in outputs]
    check_outputs(outputs, horizon)
    check_order(order, horizon, outputs[0].shape[1])
    scaling = Scaling(np.ones(0), Scaling.of([(out, out) for out in outputs]).output)
    factor = output_factor([out / scaling.output for out in outputs], horizon)
    found = stochastic_subspace(factor, horizon, n_hankel_columns(outputs, horizon))
    if order > found.rank:
        rule = f"must be at most {found.rank}: no more directions of the future depend on the past"
        raise DataError(Fault("identification", "order", rule, order))
    # The model in the units of the data.
    form, warnings = realise(found, order)
    form = form.in_units(scaling.output)
    p = found.n_outputs
    space = StateSpace(form.A, np.empty((order, 0)), form.C, np.empty((p, 0)))
    Q = form.K @ form.Re @ form.K.T
    return LinearModel(
        space,
        tuple(initial_state(space, none[: 2 * horizon], out[: 2 * horizon]) for none, out in trials),
        NoiseModel((Q + Q.T) / 2, form.Re, form.K @ form.Re),
        scaling,
        Provenance("stochastic_moesp", horizon, order, sum(map(len, outputs)), len(outputs), found.singular_values),
        warnings,
    )


def check_outputs(outputs: Sequence[Array], block_rows: int, held_back: float = 0.0) -> None:
    """Raise `DataError` with every fault of outputs (N, p): shape, NaN, no movement, too few rows.

    [Y_p; Y_f] needs as many columns as rows, ``N - 2 s + 1 >= 2 s p``, when the share ``held_back`` is set aside.
    """
    # The checks of a signal are the same for both sides, so outputs pass as their own inputs; the number of Hankel
    # columns, which differs without inputs, is checked below.
    try:
        check_trials([(out, out) for out in outputs], block_rows, None, past=False)
    except DataError as error:
        raise DataError([fault for fault in error.faults if not fault.field.startswith("input")]) from None
    n_rows, n_directions = sum(map(len, outputs)), 2 * block_rows * outputs[0].shape[1]
    n_columns = sum(max(0, n_first(len(y), held_back) - 2 * block_rows + 1) for y in outputs)
    if n_columns < n_directions:
        aside = f" without the {100 * held_back:.0f} % to validate on" if held_back else ""
        rule = (
            f"{block_rows} block rows and {outputs[0].shape[1]} outputs need {n_directions} Hankel columns{aside},"
            f" here {n_columns}"
        )
        raise DataError(Fault("identification", "training rows", rule, n_rows))


def check_order(order: int, block_rows: int, n_outputs: int) -> None:
    """Raise `DataError` when ``block_rows`` block rows cannot show ``order`` states."""
    largest = (block_rows - 1) * n_outputs
    if not 1 <= order <= largest:
        rule = f"must lie in 1..{largest}, (block rows - 1) x outputs"
        raise DataError(Fault("identification", "order", rule, order))


def output_factor(outputs: Sequence[Array], block_rows: int, start: Array | None = None) -> Array:
    """Return the triangle R (2 s p, 2 s p) of the rows [Y_p; Y_f] of all trials; ``start`` is that of earlier rows.

    No column reaches from one trial into the next, and memory holds one stretch at a time.
    """
    window, p = 2 * block_rows, outputs[0].shape[1]
    factor = empty_factor(window * p) if start is None else start
    for y in outputs:
        for first in range(0, len(y) - window + 1, COLUMNS_AT_ONCE):
            last = min(first + COLUMNS_AT_ONCE + window - 1, len(y))
            columns = np.empty((window * p, last - first - window + 1))
            fill_hankel(columns, y[first:last])
            factor = accumulate(factor, columns)
    return factor


def n_hankel_columns(outputs: Sequence[Array], block_rows: int) -> int:
    """Return the number of columns of [Y_p; Y_f] over all trials."""
    return sum(max(0, len(y) - 2 * block_rows + 1) for y in outputs)


def stochastic_subspace(factor: Array, block_rows: int, n_columns: int) -> StochasticSubspace:
    """Return the past's prediction of the future, from `output_factor`'s result over ``n_columns`` columns."""
    half = len(factor) // 2
    future = factor[:, half:]
    left, values, _ = np.linalg.svd(future[:half].T)
    rank = int(np.count_nonzero(values > _NEGLIGIBLE * np.linalg.norm(future)))
    # R11 is singular where the outputs have fewer directions than rows: lstsq returns the smallest predictor.
    predictor = np.linalg.lstsq(factor[:half, :half], future[:half], rcond=_NEGLIGIBLE)[0].T
    return StochasticSubspace(factor, np.asarray(predictor), left, values, rank, n_columns, half // block_rows)


def realise(found: StochasticSubspace, order: int) -> tuple[InnovationsForm, tuple[str, ...]]:
    """Return the model of ``order`` states in the units of the factor, and a warning if it was unstable.

    An unstable A is stabilised, and the residuals and K follow from the stabilised A.
    """
    p, half = found.n_outputs, len(found.left)
    # Balanced coordinates: G = U S^(1/2), so G^+ = S^(-1/2) U'. The floor keeps the state 0 where all values are 0,
    # that is, where the past does not predict the future.
    least = _NEGLIGIBLE * float(np.linalg.norm(found.factor)) + np.finfo(float).tiny
    weights = np.sqrt(np.maximum(found.singular_values[:order], least))
    combine = (found.left[:, :order] / weights).T @ found.predictor
    # Regression of the next state and the output on the state, and the covariance of its residuals.
    R = found.factor
    x, x_next, y = R[:, :half] @ combine.T, R[:, p : half + p] @ combine.T, R[:, half : half + p]
    gains = np.linalg.lstsq(x, np.hstack([x_next, y]))[0].T
    A, radius = stabilised(np.asarray(gains[:order]))
    C = np.asarray(gains[order:])
    residuals = np.hstack([x_next - x @ A.T, y - x @ C.T])
    joint = residuals.T @ residuals / found.n_columns
    noise = joint[order:, order:]
    noise = noise + max(_RESOLVED, _INVERTIBLE * float(np.trace(noise))) * np.eye(p)
    form = innovations_form(A, C, joint[:order, :order], noise, joint[:order, order:])
    if radius < STABLE_BELOW:
        return form, ()
    return form, (
        f"the stochastic model of order {order} was unstable, spectral radius {radius:.6g}: its eigenvalues were"
        " moved inside the unit circle and its gain worked out for that",
    )
