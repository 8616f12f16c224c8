"""ARX on a training set: number of lags by a rule, innovations form, detection of a pure gain."""

import numpy as np

from tis.common.scenario.identification import Order
from tis.patient_side.identification.arx import ArxFactor, check_lags, fit_lags
from tis.patient_side.identification.dataset import TrainingSet
from tis.patient_side.identification.fitted import Fitted
from tis.patient_side.identification.noise import estimate_noise, floored, innovations_noise
from tis.patient_side.identification.order import Candidate, choose_order, is_static
from tis.patient_side.identification.trials import Scaling, check_trials
from tis.patient_side.identification.validation import HELD_BACK, simulation_fit, split_trials


def fit_arx(training: TrainingSet, largest: int, order: Order) -> Fitted:
    """Return the ARX model of at most ``largest`` lags; ``order`` counts lags. Raises `DataError` with all faults."""
    # Checks and scaling.
    n_start = 2 * largest
    check_trials(training.trials, largest, training.labels, HELD_BACK)
    if isinstance(order, int):
        check_lags(order, largest)
    scaling = Scaling.of(training.trials)
    scaled = scaling.scaled(training.trials)
    fit_on, validate_on = split_trials(scaled)

    # The number of lags: a model of the first rows for each, compared on the last rows.
    factor_of_first = ArxFactor.of(fit_on, largest)
    candidates = []
    for lags in range(largest + 1):
        space, x0, gain, _ = fit_lags(factor_of_first, lags, fit_on, n_start)
        candidates.append(
            Candidate.of(space, x0, fit_on, largest)
            if gain is None
            else Candidate(space, gain, floored(factor_of_first.residual(lags)))
        )
    orders = choose_order(candidates, factor_of_first.n_rows, validate_on, None, n_start)
    chosen = orders.by_rule(order)
    first_rows = candidates[chosen].space
    fit = simulation_fit(first_rows, validate_on, n_start)

    # The model of all rows.
    factor = ArxFactor.of(scaled, largest)
    scaled_space, x0, gain, unstable = fit_lags(factor, chosen, scaled, n_start)
    space, out = scaling.unscaled(scaled_space), scaling.output
    if gain is None:
        noise, no_gain = estimate_noise(space, x0, training.trials, largest)
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
