"""ARX: least squares of the outputs on past outputs and inputs, as a model in innovations form.

``y[k] = B0 u[k] + sum_i (A_i y[k-i] + B_i u[k-i]) + e[k]``, i = 1..lags. Its filter needs no Riccati equation: in
observer form the Kalman gain consists of the A_i, and the residual is the innovation (Ljung, "System
Identification", sections 4.2 and 10.1). Without inputs it is the vector AR model.

ARX on a training set: number of lags by a rule, innovations form, detection of a pure gain.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tis.common.errors import DataError, Fault
from tis.common.order_rules import Order
from tis.patient_side.identification.hankel import COLUMNS_AT_ONCE, accumulate, empty_factor
from tis.patient_side.identification.linear_model import LinearModel, Provenance, Signals, as_trials, check_numbers
from tis.patient_side.identification.noise import estimate_noise, floored, innovations_noise
from tis.patient_side.identification.order import (
    NEGLIGIBLE_ERROR,
    NO_ERROR,
    Candidate,
    Fitted,
    choose_order,
    is_static,
)
from tis.patient_side.identification.output_error import STABLE_BELOW, fit_inputs, stabilised
from tis.patient_side.identification.trials import Scaling, Trial, breakdown_as_fault, check_trials
from tis.patient_side.identification.validation import HELD_BACK, initial_state, simulation_fit, split_trials
from tis.patient_side.linear_system import Array, StateSpace

_NEGLIGIBLE = 1e-10
"""Singular value of the regressors, relative to the largest, below which a direction is rounding."""


@dataclass(frozen=True)
class ArxFactor:
    """The triangle of [u; y and u one sample ago; two; ...; y]: its leading columns serve smaller numbers of lags.

    All numbers of lags thus explain the same ``n_rows`` rows, from the largest number of lags on.
    """

    factor: Array
    n_rows: int
    n_inputs: int
    n_outputs: int

    @classmethod
    def of(cls, trials: Sequence[Trial], n_lags: int) -> "ArxFactor":
        """Return the triangle of trials (N, m), (N, p); m may be 0. No row crosses a trial's border."""
        m, p = trials[0][0].shape[1], trials[0][1].shape[1]
        factor, n_rows = empty_factor(m + n_lags * (m + p) + p), 0
        for u, y in trials:
            both = np.ascontiguousarray(np.hstack([y, u]).T)
            for first in range(n_lags, len(u), COLUMNS_AT_ONCE):
                last = min(first + COLUMNS_AT_ONCE, len(u))
                lagged = [both[:, first - lag : last - lag] for lag in range(1, n_lags + 1)]
                factor = accumulate(factor, np.concatenate([both[p:, first:last], *lagged, both[:p, first:last]]))
            n_rows += max(0, len(u) - n_lags)
        return cls(factor, n_rows, m, p)

    def residual(self, lags: int) -> Array:
        """Return the residuals' covariance (p, p) with ``lags`` lags."""
        rest = self.factor[self.n_inputs + lags * (self.n_inputs + self.n_outputs) :, -self.n_outputs :]
        return np.asarray(rest.T @ rest / self.n_rows)

    def model(self, lags: int) -> tuple[StateSpace, Array]:
        """Return the least-squares model of ``lags`` lags with lags x p states, and its gain K (n, p).

        The state's i-th block is the past's contribution to the output i - 1 samples from now.
        """
        m, p = self.n_inputs, self.n_outputs
        n_columns = m + lags * (m + p)
        regressors, outputs = self.factor[:n_columns, :n_columns], self.factor[:n_columns, -p:]
        solution = np.linalg.lstsq(regressors, outputs, rcond=_NEGLIGIBLE)[0].T
        D = np.ascontiguousarray(solution[:, :m])
        lagged = solution[:, m:].reshape(p, lags, p + m).transpose(1, 0, 2).reshape(lags * p, p + m)
        K = np.ascontiguousarray(lagged[:, :p])
        A = np.eye(lags * p, k=p)
        A[:, :p] += K[:, : len(A)]  # without lags there are no states
        return StateSpace(A, lagged[:, p:] + K @ D, np.eye(p, lags * p), D), K


@breakdown_as_fault("arx")
def identify(u: Signals, y: Signals, order: int, horizon: int, *, stable: bool = True) -> LinearModel:
    """Return the ARX model of ``order`` lags, 0 for y = D u, fitted to all rows but each trial's first ``horizon``.

    The parameters are those of `identify_subspace`, with ``order`` the number of lags; an unstable model is
    stabilised, and B, D, x0 and the noise are fitted to the result. Raises `DataError`. Oracles in test_arx: numpy's
    least squares on regressors built row by row, and a known system.
    """
    check_numbers(order, horizon)
    trials = as_trials(u, y)
    check_trials(trials, horizon, fewest_inputs=0)
    check_lags(order, horizon)
    scaling = Scaling.of(trials)
    scaled = scaling.scaled(trials)
    factor = ArxFactor.of(scaled, horizon)
    scaled_space, x0, gain, unstable = fit_lags(factor, order, scaled, horizon, stable=stable)
    space = scaling.unscaled(scaled_space)
    if gain is None:
        noise, _ = estimate_noise(space, x0, trials, horizon)
    else:
        noise = innovations_noise(
            gain / scaling.output, scaling.output[:, None] * factor.residual(order) * scaling.output
        )
    n_rows = sum(len(inputs) for inputs, _ in trials)
    provenance = Provenance("arx", horizon, order, n_rows, len(trials), np.empty(0))
    return LinearModel(space, x0, noise, scaling, provenance, unstable)


def check_lags(lags: int, largest: int) -> None:
    """Raise `DataError` when ``lags`` is negative or above ``largest``, the number of block rows."""
    if not 0 <= lags <= largest:
        raise DataError(Fault("identification", "order", f"must lie in 0..{largest}, the lags of arx", lags))


def fit_lags(
    factor: ArxFactor, lags: int, trials: Sequence[Trial], n_start: int, *, stable: bool = True
) -> tuple[StateSpace, tuple[Array, ...], Array | None, tuple[str, ...]]:
    """Return model, each trial's x0 from its first ``n_start`` rows, gain, and a warning if it was unstable.

    A gain is valid for its own A only: a stabilised model has none. Without ``stable`` an unstable A stays.
    """
    space, gain = factor.model(lags)
    A, radius = stabilised(space.A)
    if radius < STABLE_BELOW or not stable:
        return space, tuple(initial_state(space, u[:n_start], y[:n_start]) for u, y in trials), gain, ()
    B, D, x0 = fit_inputs(A, space.C, trials)
    warning = (
        f"the ARX model of {lags} lags was unstable, spectral radius {radius:.6g}: its eigenvalues were moved"
        " inside the unit circle and B, D, x0 and the noise fitted to that"
    )
    return StateSpace(A, B, space.C, D), x0, None, (warning,)


def fit_arx(
    trials: Sequence[Trial], labels: Sequence[str], largest: int, order: Order, *, stable: bool = True
) -> Fitted:
    """Return the ARX model of at most ``largest`` lags; ``order`` counts lags. Raises `DataError` with all faults."""
    # Checks and scaling.
    n_start = 2 * largest
    check_trials(trials, largest, labels, HELD_BACK, fewest_inputs=0)
    if isinstance(order, int):
        check_lags(order, largest)
    scaling = Scaling.of(trials)
    scaled = scaling.scaled(trials)
    fit_on, validate_on = split_trials(scaled)

    # The number of lags: a model of the first rows for each, compared on the last rows.
    factor_of_first = ArxFactor.of(fit_on, largest)
    candidates = []
    for lags in range(largest + 1):
        space, x0, gain, _ = fit_lags(factor_of_first, lags, fit_on, n_start, stable=stable)
        candidates.append(
            Candidate.of(space, x0, fit_on, largest)
            if gain is None
            else Candidate(space, gain, floored(factor_of_first.residual(lags)))
        )
    negligible = NEGLIGIBLE_ERROR if stable else NO_ERROR
    orders = choose_order(candidates, factor_of_first.n_rows, validate_on, None, n_start, negligible)
    chosen = orders.by_rule(order)
    first_rows = candidates[chosen].space
    fit = simulation_fit(first_rows, validate_on, n_start)

    # The model of all rows.
    factor = ArxFactor.of(scaled, largest)
    scaled_space, x0, gain, unstable = fit_lags(factor, chosen, scaled, n_start, stable=stable)
    space, out = scaling.unscaled(scaled_space), scaling.output
    if gain is None:
        noise, no_gain = estimate_noise(space, x0, trials, largest)
    else:
        noise, no_gain = innovations_noise(gain / out, out[:, None] * factor.residual(chosen) * out), ()
    return Fitted(
        space=space,
        x0=x0[0],
        noise=noise,
        singular_values=np.empty(0),
        orders=orders,
        first_rows=scaling.unscaled(first_rows),
        fit=fit,
        n_start=n_start,
        static=is_static(chosen, fit),
        warnings=(*unstable, *no_gain),
    )
