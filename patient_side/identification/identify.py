"""The one entry point: from training recordings to all that the patient knows of an arm."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common.channels import Hand
from common.scenario.patient import Identification
from common.sources.trajectory import Recording
from patient_side.identification.dataset import TrainingSet, training_set
from patient_side.identification.forecast import fit_forecast
from patient_side.identification.moesp import (
    Subspace,
    check_excitation,
    check_order,
    fit_order,
    subspace,
    triangular_factor,
)
from patient_side.identification.noise import estimate_noise
from patient_side.identification.order import OrderChoice, choose_order, is_static
from patient_side.identification.trials import Scaling, Trial, check_trials
from patient_side.identification.validation import HELD_BACK, SimulationFit, simulation_fit, split_trials
from patient_side.statespace import ArmModel

_POOR_FIT_PCT = 50.0


@dataclass(frozen=True)
class Identified:
    """A model, and what each rule says of its order: None when the order was given."""

    model: ArmModel
    orders: OrderChoice | None


def identify_arm(
    trainings: Sequence[Recording], hand: Hand, identification: Identification, pairing: str
) -> ArmModel:
    """Return the model of the arm that follows ``hand``; raises `DataError` with all faults.

    ``identification.train`` of ``others`` pools both hands of all recordings. ``pairing`` is what the
    source says of master and arm, kept with the model. ``x0`` is the state at the first training row; zero,
    the operating point, for ``others``, whose rows are not the run's. ``static`` says that a gain is the
    whole relation.
    """
    return identify_with_orders(trainings, hand, identification, pairing).model


def identify_with_orders(
    trainings: Sequence[Recording], hand: Hand, identification: Identification, pairing: str
) -> Identified:
    """Return the model as `identify_arm` does, with the order rules' answers."""
    others = identification.train == "others"
    block_rows = identification.block_rows
    training = training_set(trainings, hand, pool_hands=others)
    check_trials(training.trials, block_rows, training.labels, HELD_BACK)
    scaling = Scaling.of(training.trials)
    scaled = scaling.scaled(training.trials)
    fit_on, validate_on = split_trials(scaled)
    found_on_first, found, warnings = _subspaces(scaled, fit_on, block_rows)

    orders = None
    if identification.order == "auto":
        orders = choose_order(found_on_first, fit_on, validate_on, found.singular_values)
        order, fit = orders.validation, orders.fits[orders.validation]
    else:
        order = identification.order
        check_order(order, block_rows, found.n_outputs)
        fit = simulation_fit(fit_order(found_on_first, order, fit_on)[0], validate_on, 2 * block_rows)

    scaled_space, x0, unstable = fit_order(found, order, scaled)
    space = scaling.unscaled(scaled_space)
    noise, no_gain = estimate_noise(space, x0, training.trials, block_rows)
    static = is_static(order, fit)
    if static:
        warnings = ()  # a gain needs no excitation over time, only movement in every direction
    model = ArmModel(
        hand=hand,
        arm=training.arm,
        rate_hz=training.rate_hz,
        method=identification.method,
        order=order,
        block_rows=block_rows,
        train=identification.train,
        space=space,
        x0=np.zeros(order) if others else x0[0],
        noise=noise,
        forecast=fit_forecast(training.commands, training.rate_hz),
        input_offset_m=training.input_offset_m,
        output_offset_m=training.output_offset_m,
        output_low_m=training.output_low_m,
        output_high_m=training.output_high_m,
        singular_values=found.singular_values,
        fit_pct=fit.fit_pct,
        spectral_radius=space.spectral_radius(),
        pairing=pairing,
        static=static,
        warnings=(*warnings, *unstable, *no_gain, *_poor_fit(fit, hand, training)),
    )
    return Identified(model, orders)


def _subspaces(
    trials: Sequence[Trial], fit_on: Sequence[Trial], block_rows: int
) -> tuple[Subspace, Subspace, tuple[str, ...]]:
    """Return the subspaces of the first rows and of all rows; the second factor continues the first."""
    n_inputs, n_outputs = trials[0][0].shape[1], trials[0][1].shape[1]
    first = triangular_factor(fit_on, block_rows)
    window = 2 * block_rows
    # the columns not met yet begin where the last one of the first rows began, plus one
    rest = [
        (u[max(0, len(head) - window + 1) :], y[max(0, len(head) - window + 1) :])
        for (u, y), (head, _) in zip(trials, fit_on, strict=True)
    ]
    factor = triangular_factor(rest, block_rows, first)
    warnings = check_excitation(factor, block_rows, n_inputs)
    return (
        subspace(first, block_rows, n_inputs, n_outputs),
        subspace(factor, block_rows, n_inputs, n_outputs),
        warnings,
    )


def _poor_fit(fit: SimulationFit, hand: Hand, training: TrainingSet) -> tuple[str, ...]:
    if min(fit.fit_pct) >= _POOR_FIT_PCT:
        return ()
    shares = " ".join(f"{share:.0f}" for share in fit.fit_pct)
    return (
        f"a simulation explains only {shares} % of {training.arm}'s x y z on the held-back rows:"
        f" it may not be the arm that follows the {hand} hand",
    )
