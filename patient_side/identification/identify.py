"""The one entry point: from training recordings to all that the patient knows of an arm."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from common.channels import Hand
from common.scenario.patient import Identification
from common.sources.provenance import training_rows
from common.sources.trajectory import Recording
from patient_side.identification.breakdown import breakdown_as_fault, repeats_told
from patient_side.identification.companions import fit_companions
from patient_side.identification.dataset import TrainingSet, training_set
from patient_side.identification.fit_arx import fit_arx
from patient_side.identification.fit_moesp_paper import fit_moesp_paper
from patient_side.identification.fit_subspace import fit_subspace
from patient_side.identification.fitted import Fitted
from patient_side.identification.forecast import fit_forecast
from patient_side.identification.methods import SUBSPACE_METHODS
from patient_side.identification.order import OrderChoice
from patient_side.identification.validation import SimulationFit, fit_text, simulate_on, split_trials
from patient_side.statespace import ArmModel, Array

_POOR_FIT_PCT = 50.0

LOOKS_AHEAD = (
    "the model looks ahead: its velocity inputs are smoothed over frames after their own, so its fit is no promise"
    " for a run"
)


@dataclass(frozen=True)
class ValidationRun:
    """The arm (N, 3) on the validation rows of one training trial, in m about the operating point, and simulated.

    The simulation knows the commands, and begins from a state fitted to the first ``n_start`` rows; it is of the
    model of the rows before, the first of which has the index ``first_row``.
    """

    label: str
    first_row: int
    n_start: int
    truth_m: Array
    simulated_m: Array


@dataclass(frozen=True)
class Identified:
    """A model, what each rule says of its order, and how it simulates what it was not fitted on."""

    model: ArmModel
    orders: OrderChoice
    validation: ValidationRun


def identify_arm(
    trainings: Sequence[Recording],
    hand: Hand,
    identification: Identification,
    pairing: str,
    wanted: Collection[str] | None = (),
) -> ArmModel:
    """Return the model of the arm that follows ``hand``; raises `DataError` with all faults.

    ``identification.train`` of ``others`` pools both hands of all recordings. ``pairing`` is what the
    source says of master and arm, kept with the model. ``x0`` is the state at the first training row; zero,
    the operating point, for ``others``, whose rows are not the run's, and for ``moesp_paper``. ``static`` says
    that a gain is the whole relation. The operating point is the training rows' mean; for ``moesp_paper``, whose
    normalisation begins there, the lower ends of their ranges. The model also holds what the estimators ``wanted``
    need beside it; of None, what any does, as far as the rows allow it. ``trained_on`` names the trainings' rows,
    those held back for validation too: they decide the order.
    """
    return identify_with_orders(trainings, hand, identification, pairing, wanted).model


def identify_with_orders(
    trainings: Sequence[Recording],
    hand: Hand,
    identification: Identification,
    pairing: str,
    wanted: Collection[str] | None = (),
) -> Identified:
    """Return the model as `identify_arm` does, with the order rules' answers and the run on validation rows."""
    commands_m = [part.command.position_m for each in trainings for part in each.hands if part.hand == hand]
    with repeats_told(commands_m), breakdown_as_fault(identification.method):
        return _identified(trainings, hand, identification, pairing, wanted)


def _identified(
    trainings: Sequence[Recording],
    hand: Hand,
    identification: Identification,
    pairing: str,
    wanted: Collection[str] | None,
) -> Identified:
    others, paper = identification.train == "others", identification.method == "moesp_paper"
    ahead = identification.looks_ahead
    training = training_set(trainings, hand, pool_hands=others, about="lowest" if paper else "mean", velocities=ahead)
    fitted = _fit(training, identification)
    order = fitted.space.order
    about_mean = training_set(trainings, hand, pool_hands=others) if paper else training

    def about_lowest() -> TrainingSet:
        return training_set(trainings, hand, pool_hands=others, about="lowest")

    beside = fit_companions(about_mean, identification, wanted, None if paper else about_lowest)
    model = ArmModel(
        hand=hand,
        arm=training.arm,
        rate_hz=training.rate_hz,
        method=identification.method,
        order=order,
        block_rows=identification.block_rows,
        train=identification.train,
        space=fitted.space,
        x0=np.zeros(order) if others else fitted.x0,
        noise=fitted.noise,
        forecast=fit_forecast(training.commands, training.rate_hz),
        input_offset_m=training.input_offset_m,
        output_offset_m=training.output_offset_m,
        output_low_m=training.output_low_m,
        output_high_m=training.output_high_m,
        singular_values=fitted.singular_values,
        fit_pct=fitted.fit.fit_pct,
        spectral_radius=fitted.space.spectral_radius(),
        pairing=pairing,
        static=fitted.static,
        warnings=(
            *fitted.warnings,
            *((LOOKS_AHEAD,) if ahead else ()),
            *_poor_fit(fitted.fit, hand, training, paper),
            *beside.warnings,
            *(() if identification.train == "own_head" else _anomalies(trainings)),
        ),
        trained_on=training_rows(trainings),
        innovations=beside.innovations,
        n4sid=beside.n4sid,
        arx=beside.arx,
        autoregression=beside.autoregression,
        direct=beside.direct,
        paper=beside.paper,
    )
    return Identified(model, fitted.orders, _validation_run(training, fitted))


def _fit(training: TrainingSet, identification: Identification) -> Fitted:
    method, block_rows = identification.method, identification.block_rows
    if method == "moesp_paper":
        return fit_moesp_paper(training, identification)
    if method == "arx":
        return fit_arx(training, block_rows, identification.order)
    return fit_subspace(training, SUBSPACE_METHODS[method], block_rows, identification.order)


def _validation_run(training: TrainingSet, fitted: Fitted) -> ValidationRun:
    """Return the run on the trial with the most validation rows."""
    fit_on, validate_on = split_trials(training.trials)
    longest = int(np.argmax([len(u) for u, _ in validate_on]))
    u, y = validate_on[longest]
    with np.errstate(over="ignore", invalid="ignore"):  # an unstable model's
        simulated = simulate_on(fitted.first_rows, u, y, fitted.n_start)
    return ValidationRun(training.labels[longest], len(fit_on[longest][0]), fitted.n_start, y, simulated)


def _anomalies(trainings: Sequence[Recording]) -> list[str]:
    """Return what is implausible of recordings that the run does not play; of its own it says so itself."""
    return [f"trained on {text}" for recording in trainings for text in recording.anomalies]


def _poor_fit(fit: SimulationFit, hand: Hand, training: TrainingSet, paper: bool) -> tuple[str, ...]:
    if min(fit.fit_pct) >= _POOR_FIT_PCT:
        return ()
    shares = " ".join(fit_text(share, 0) for share in fit.fit_pct)
    # the paper's method simulates badly even where the arm is the right one
    reason = (
        "without measurements the model is of no use"
        if paper
        else f"it may not be the arm that follows the {hand} hand"
    )
    return (f"a simulation explains only {shares} % of {training.arm}'s x y z on the held-back rows: {reason}",)
