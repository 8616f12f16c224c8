"""The model order by four rules that often disagree, all of them reported; ``auto`` is the validated order."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import log

import numpy as np

from tis.common.errors import DataError, Fault
from tis.common.order_rules import Order
from tis.patient_side.identification.noise import estimate_noise, innovations, innovations_noise
from tis.patient_side.identification.output_error import STABLE_BELOW
from tis.patient_side.identification.trials import Scaling, Trial
from tis.patient_side.identification.validation import SimulationFit, prediction_error, simulation_fit
from tis.patient_side.linear_system import Array, NoiseModel, StateSpace

MAX_ORDER = 12
_ENERGY_SHARE = 0.85
_RELATIVE_TOLERANCE = 1.05
NEGLIGIBLE_ERROR = 0.05
"""In units of hold's error. With the inputs' forecast, at best 0.4, it adds sqrt(0.4^2 + 0.05^2) - 0.4 = 0.003."""

NO_ERROR = 1e-6
"""The same bound for a system that others than the testbed's filters use: what rounding leaves without noise."""

_STATIC_FIT_PCT = 90.0


@dataclass(frozen=True)
class Candidate:
    """A model of some order fitted to the first rows: its gain (n, p) and its innovations' covariance there."""

    space: StateSpace
    gain: Array
    covariance: Array

    @classmethod
    def of(
        cls,
        space: StateSpace,
        x0: Sequence[Array],
        trials: Sequence[Trial],
        lags: int,
        residuals: Sequence[Array] | None = None,
    ) -> "Candidate":
        """Return a model with the gain of `estimate_noise`; an unstable one gets the gain zero."""
        if space.spectral_radius() < STABLE_BELOW:
            noise, _ = estimate_noise(space, x0, trials, lags, residuals)
            return cls(space, noise.gain, noise.R)
        gain = np.zeros((space.order, space.n_outputs))
        with np.errstate(over="ignore", invalid="ignore"):
            errors = np.concatenate(innovations(space, gain, x0, trials))
            return cls(space, gain, errors.T @ errors / len(errors))

    def noise(self, scaling: Scaling) -> NoiseModel:
        """Return the noise in innovations form, in the units that ``scaling`` leads back to."""
        out = scaling.output
        return innovations_noise(self.gain / out, out[:, None] * self.covariance * out)

    def criterion(self, n_rows: int) -> float:
        """Return Bauer's IVC (2001, Automatica 37:1561) with Schwarz's penalty, per row: log det Re + d log N / N.

        d = n (m + 2 p) + m p is the number of parameters of a model in innovations form, in any coordinates.
        """
        n, m, p = self.space.order, self.space.n_inputs, self.space.n_outputs
        if not np.all(np.isfinite(self.covariance)):
            return float(np.finfo(float).max)
        return float(np.linalg.slogdet(self.covariance)[1]) + (n * (m + 2 * p) + m * p) * log(n_rows) / n_rows


@dataclass(frozen=True)
class OrderChoice:
    """The order by each rule; element n of the tuples belongs to the candidate of order n.

    ``fits`` score simulations of the held-back rows, ``predictions`` are the errors of predicting them 5 samples
    ahead over those of hold. For ``arx`` an order counts lags, and `energy` and `log_gap` are None, as it has no
    singular values.
    """

    energy: int | None
    log_gap: int | None
    criterion: int
    validation: int
    fits: tuple[SimulationFit, ...]
    predictions: tuple[float, ...]

    def by_rule(self, order: Order) -> int:
        """Return the order for a scenario's ``identification.order``; raises `DataError`."""
        if isinstance(order, int):
            return order
        rules = {"energy": self.energy, "gap": self.log_gap, "criterion": self.criterion}
        chosen = rules.get(order, self.validation)
        if chosen is None:
            raise DataError(Fault("identification", "order", "needs singular values, and arx has none", order))
        return chosen


def is_static(order: int, fit: SimulationFit) -> bool:
    """Return whether a gain alone is the whole relation: no states, and 90 % of every axis explained."""
    return order == 0 and min(fit.fit_pct) >= _STATIC_FIT_PCT


def energy_order(singular_values: Array) -> int:
    """Return the smallest number of singular values with 85 % of their sum (the paper's rule); 0 if all are 0."""
    total = float(np.sum(singular_values))
    if total == 0:
        return 0
    return int(np.searchsorted(np.cumsum(singular_values), _ENERGY_SHARE * total)) + 1


def log_gap_order(singular_values: Array) -> int:
    """Return the order before the largest ratio of one singular value to the next; 0 when all are 0.

    Values below 1e-10 of the largest are rounding: they are raised to that bound, so that they have no gaps.
    """
    if len(singular_values) < 2 or singular_values[0] == 0:
        return 0
    logs = np.log(np.maximum(singular_values, 1e-10 * singular_values[0]))
    return int(np.argmax(logs[:-1] - logs[1:])) + 1


def largest_candidate(rank: int, block_rows: int, n_outputs: int) -> int:
    """Return the largest order to fit, within rank, shift and `MAX_ORDER`."""
    return min(MAX_ORDER, rank, (block_rows - 1) * n_outputs)


def choose_order(
    candidates: Sequence[Candidate],
    n_fitted: int,
    validate_on: Sequence[Trial],
    singular_values: Array | None,
    n_start: int,
    negligible: float = NEGLIGIBLE_ERROR,
) -> OrderChoice:
    """Simulate and predict the last rows with every candidate, and return the orders by all rules.

    ``candidates[n]`` has the order n and is fitted to ``n_fitted`` first rows, in the units of ``validate_on``;
    ``singular_values`` are those of all rows. The validated order is the smallest one whose prediction error lies
    within 5 % of the smallest, or below ``negligible`` of hold's error: a smaller improvement is not worth
    a state.
    """
    fits = [simulation_fit(candidate.space, validate_on, n_start) for candidate in candidates]
    predictions = [prediction_error(each.space, each.gain, validate_on, n_start) for each in candidates]
    criteria = [candidate.criterion(n_fitted) for candidate in candidates]
    return OrderChoice(
        None if singular_values is None else energy_order(singular_values),
        None if singular_values is None else log_gap_order(singular_values),
        int(np.argmin(criteria)),
        smallest_sufficient(predictions, negligible),
        tuple(fits),
        tuple(predictions),
    )


def smallest_sufficient(errors: Sequence[float], negligible: float = NEGLIGIBLE_ERROR) -> int:
    """Return the smallest order whose error equals the best one within the tolerances."""
    best = min(errors)
    bound = max(_RELATIVE_TOLERANCE * best, negligible)
    return next(order for order, error in enumerate(errors) if error <= bound)


@dataclass(frozen=True)
class Fitted:
    """A model of all training rows, and the results of the order selection.

    ``x0`` (n,) is the state at the first training row. ``singular_values`` are those of all rows, ``orders`` the
    orders by the rules. ``first_rows`` is the model of the same order fitted before the validation rows, ``fit`` its
    simulation of these, started from their first ``n_start`` rows.
    """

    space: StateSpace
    x0: Array
    noise: NoiseModel
    singular_values: Array
    orders: OrderChoice
    first_rows: StateSpace
    fit: SimulationFit
    n_start: int
    static: bool
    warnings: tuple[str, ...]
