"""The paper's identification: min-max scaling, Algorithm 2, order by 85 % energy, empirical Q and R."""

import numpy as np

from common.errors import DataError, Fault
from common.scenario.patient import Identification
from patient_side.identification.dataset import TrainingSet
from patient_side.identification.fitted import Fitted
from patient_side.identification.moesp_paper import PaperSubspace, paper_model, paper_subspace
from patient_side.identification.noise import floored
from patient_side.identification.order import Candidate, OrderChoice, choose_order, energy_order, largest_candidate
from patient_side.identification.paper_noise import empirical_noise
from patient_side.identification.subspace import check_order
from patient_side.identification.trials import Scaling, check_trials
from patient_side.identification.validation import HELD_BACK, simulation_fit, split_trials
from patient_side.statespace import NoiseModel


def fit_moesp_paper(training: TrainingSet, identification: Identification) -> Fitted:
    """Return the paper's model of a training set about the lower ends of its ranges; raises `DataError`.

    x0 is zero: the listing estimates none, and its filter starts without one. An unstable A is kept, with a warning.
    R, in metres, is floored at the sensor's resolution, far below the residuals of the paper's run. The validation
    rows serve the report only: the order is the energy rule's on all rows, or the configured one.
    """
    # The listing's subspaces, of all rows and of the first rows.
    block_rows = identification.block_rows
    check_trials(training.trials, block_rows, training.labels, HELD_BACK, past=False)
    scaling = Scaling.by_range(training.trials)
    scaled = scaling.scaled(training.trials)
    fit_on, validate_on = split_trials(scaled)
    found, excitation = paper_subspace(scaled, block_rows)
    found_on_first, _ = paper_subspace(fit_on, block_rows)

    # The order, with all rules for the report.
    n_start = 2 * block_rows
    largest = largest_candidate(found_on_first.rank, block_rows, found.n_outputs)
    candidates = [
        Candidate.of(paper_model(found_on_first, n), [np.zeros(n)] * len(fit_on), fit_on, block_rows)
        for n in range(largest + 1)
    ]
    n_fitted = sum(len(u) for u, _ in fit_on)
    orders = choose_order(candidates, n_fitted, validate_on, found.singular_values, n_start)
    order, cut = _order(found, orders, identification)
    first_rows = paper_model(found_on_first, order)

    # The model of all rows with its noise.
    scaled_space = paper_model(found, order)
    noise = empirical_noise(scaled_space, scaled, identification.epsilon_q, identification.epsilon_r)
    R = scaling.output[:, None] * noise.R * scaling.output
    radius = scaled_space.spectral_radius()
    unstable = (
        f"the paper's model of order {order} is unstable, spectral radius {radius:.6g}, and used as it is:"
        " without measurements it runs away",
    )
    return Fitted(
        space=scaling.unscaled(scaled_space),
        x0=np.zeros(order),
        noise=NoiseModel(noise.Q, floored(R), noise.S),
        singular_values=found.singular_values,
        orders=orders,
        first_rows=scaling.unscaled(first_rows),
        fit=simulation_fit(first_rows, validate_on, n_start),
        n_start=n_start,
        static=False,
        warnings=(*excitation, *cut, *(unstable if radius >= 1 else ())),
    )


def _order(found: PaperSubspace, orders: OrderChoice, identification: Identification) -> tuple[int, tuple[str, ...]]:
    """Return the order, and a warning where a rule requires more states than the block rows can show.

    ``auto`` is the paper's rule, energy. The order is at least one, as its filter needs a state.
    """
    block_rows, rule = identification.block_rows, identification.order
    if isinstance(rule, int):
        check_order(rule, block_rows, found.n_outputs, smallest=1)
        return rule, ()
    if found.rank == 0:
        text = "moesp_paper finds no state: the inputs of the same stretch explain the outputs; use method moesp"
        raise DataError(Fault("identification", "order", text))
    if rule not in ("auto", "energy"):
        return max(1, orders.by_rule(rule)), ()
    wanted, largest = energy_order(found.singular_values), (block_rows - 1) * found.n_outputs
    if wanted <= largest:
        return wanted, ()
    text = f"85 % of the singular values' sum takes {wanted} states, {block_rows} block rows show {largest}: these"
    return largest, (f"{text} are used",)
