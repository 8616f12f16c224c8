"""The entry point of identification: from training recordings to all models of an arm."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from tis.common.channels import Hand
from tis.common.scenario.identification import Identification
from tis.common.sources.provenance import training_rows
from tis.common.sources.trajectory import Recording
from tis.patient_side.identification.arx import fit_arx
from tis.patient_side.identification.companions import Companions, Stage, fit_companions, untimed
from tis.patient_side.identification.dataset import TrainingSet, movement_of, training_set
from tis.patient_side.identification.forecast import fit_forecast
from tis.patient_side.identification.moesp_paper import fit_moesp_paper
from tis.patient_side.identification.order import Fitted, OrderChoice
from tis.patient_side.identification.subspace_methods import SUBSPACE_METHODS, fit_subspace
from tis.patient_side.identification.trials import breakdown_as_fault, explain_repeats
from tis.patient_side.identification.validation import SimulationFit, fewest_rows, fit_text, simulate_on, split_trials
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import InputForecast
from tis.patient_side.statespace import ArmModel, FilterModel

_POOR_FIT_PCT = 50.0
_RESTING = 0.02
"""Share of the largest axis' range below which an axis rests."""

LOOKS_AHEAD = (
    "the model looks ahead: its velocity inputs are smoothed over frames after their own, so its fit is no promise"
    " for a run"
)


@dataclass(frozen=True)
class ValidationRun:
    """Recorded and simulated arm (N, 3) on one trial's validation rows, in m about the operating point.

    The simulation is that of the model fitted before the validation rows, which begin at the recording's row
    ``first_row``; its inputs
    are the commands, and its initial state is fitted to the first ``n_start`` rows.
    """

    label: str
    first_row: int
    n_start: int
    truth_m: Array
    simulated_m: Array


@dataclass(frozen=True)
class Identified:
    """A model, its order by each rule, and its simulation of rows that it was not fitted to."""

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
    """Identify the models of the arm that follows ``hand``.

    Parameters
    ----------
    trainings
        Training recordings, at one rate. With ``identification.train`` of ``others`` both hands of all recordings are
        pooled.
    hand
        The hand whose arm is modelled.
    identification
        Method, block rows, order and the other settings of the scenario.
    pairing
        The source's pairing of masters and arms, stored with the model.
    wanted
        Names of the estimators and orientation methods whose models are fitted as well; None: all, as far as the rows
        allow.

    Returns
    -------
    ArmModel
        Its operating point is the training rows' mean; for ``moesp_paper``, whose normalisation begins there, the
        lower ends of their ranges. ``x0`` is the state at the first row that is learned from; zero, the operating
        point, for ``others``, whose rows are not the run's, and for ``moesp_paper``. ``trained_on`` includes the rows
        held back for validation, as they decide the order, and those that are too few between two jumps.

    Raises
    ------
    DataError
        With all faults of the rows, where a chosen or wanted model cannot be fitted to them.

    Examples
    --------
    >>> model = identify_arm([recording], "right", Identification(), recording.pairing, ["innovations_kf"])
    >>> estimator = build_estimator("innovations_kf", model)
    """
    return identify_with_orders(trainings, hand, identification, pairing, wanted).model


def identify_with_orders(
    trainings: Sequence[Recording],
    hand: Hand,
    identification: Identification,
    pairing: str,
    wanted: Collection[str] | None = (),
) -> Identified:
    """Return the model as `identify_arm` does, with the orders by all rules and the run on validation rows."""
    return identify_hands(trainings, [hand], identification, pairing, wanted)[0]


def identify_hands(
    trainings: Sequence[Recording],
    hands: Sequence[Hand],
    identification: Identification,
    pairing: str,
    wanted: Collection[str] | None = (),
    stage: Stage = untimed,
) -> tuple[Identified, ...]:
    """Return what `identify_with_orders` returns for each of the ``hands``.

    With `others` the hands are pooled: all fits are made once, and the hands' models differ in the operating point,
    the range and what depends on these. ``stage`` returns a context in which the model for the estimator of that name
    is fitted beside the chosen one. Oracle: each hand on its own, test_identify_hands.
    """
    rows = [_Rows.of(trainings, hand, identification) for hand in hands]
    fits: list[_Fits] = []
    for each in rows:
        pooled = fits and identification.train == "others"
        fits.append(fits[0] if pooled else _fits(each, identification, wanted, stage))
    return tuple(
        _identified(trainings, each, found, identification, pairing) for each, found in zip(rows, fits, strict=True)
    )


@dataclass(frozen=True)
class _Rows:
    """The training sets of one hand: for the chosen model, and for those beside it.

    ``commands_m`` and ``arms_m`` are all its rows. Beside it are models about the mean and without velocities, but
    the paper's about the lowest values.
    """

    hand: Hand
    commands_m: tuple[Array, ...]
    arms_m: tuple[Array, ...]
    training: TrainingSet
    about_mean: TrainingSet
    about_lowest: Callable[[], TrainingSet] | None

    @classmethod
    def of(cls, trainings: Sequence[Recording], hand: Hand, identification: Identification) -> "_Rows":
        """Return the sets for a scenario's identification; raises `DataError`."""
        others, paper = identification.train == "others", identification.method == "moesp_paper"
        shortest = fewest_rows(identification.block_rows)
        rows = partial(training_set, trainings, hand, pool_hands=others, shortest=shortest)
        own = [part for each in trainings for part in each.hands if part.hand == hand]
        commands_m = [part.command.position_m for part in own]
        with explain_repeats(commands_m):
            training = rows(about="lowest" if paper else "mean", velocities=identification.looks_ahead)
            about_mean = rows() if paper else training
        about_lowest = None if paper else partial(rows, about="lowest")
        arms_m = tuple(part.follower.position_m for part in own)
        return cls(hand, tuple(commands_m), arms_m, training, about_mean, about_lowest)


@dataclass(frozen=True)
class _Fits:
    """What is fitted to trials, which pooled hands share."""

    chosen: Fitted
    beside: Companions
    forecast: InputForecast


def _fits(rows: _Rows, identification: Identification, wanted: Collection[str] | None, stage: Stage) -> _Fits:
    with explain_repeats(rows.commands_m), breakdown_as_fault(identification.linear_method):
        chosen = _fit(rows.training, identification)
        return _Fits(
            chosen,
            fit_companions(rows.about_mean, identification, wanted, rows.about_lowest, stage, static=chosen.static),
            fit_forecast(rows.training.commands, rows.training.rate_hz),
        )


def _identified(
    trainings: Sequence[Recording], rows: _Rows, fits: _Fits, identification: Identification, pairing: str
) -> Identified:
    hand, training, fitted, beside = rows.hand, rows.training, fits.chosen, fits.beside
    others, order = identification.train == "others", fitted.space.order
    model = ArmModel(
        hand=hand,
        arm=training.arm,
        rate_hz=training.rate_hz,
        method=identification.linear_method,
        order=order,
        block_rows=identification.block_rows,
        train=identification.train,
        space=fitted.space,
        x0=np.zeros(order) if others else fitted.x0,
        noise=fitted.noise,
        forecast=fits.forecast,
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
            *training.warnings,
            *fitted.warnings,
            *((LOOKS_AHEAD,) if identification.looks_ahead else ()),
            *_poor_fit(fitted.fit, hand, training, identification.method == "moesp_paper"),
            *beside.warnings,
            *(() if identification.train == "own_head" else _doubts(trainings)),
        ),
        trained_on=training_rows(trainings),
        command_movement=movement_of(rows.commands_m, rows.about_mean.input_offset_m, training.rate_hz),
        arm_movement=movement_of(rows.arms_m, rows.about_mean.output_offset_m, training.rate_hz),
        **{field: _about(rows.about_mean, field, found) for field, found in beside.models.items()},
    )
    return Identified(model, fitted.orders, _validation_run(training, fitted))


def _about(training: TrainingSet, field: str, model: Any) -> Any:
    """Return a linear model with the hand's operating point; that of the paper's is the same for pooled hands."""
    if not isinstance(model, FilterModel) or field == "paper":
        return model
    return replace(model, input_offset_m=training.input_offset_m, output_offset_m=training.output_offset_m)


def _fit(training: TrainingSet, identification: Identification) -> Fitted:
    method, block_rows = identification.linear_method, identification.block_rows
    if method == "moesp_paper":
        return fit_moesp_paper(training, identification)
    if method == "arx":
        return fit_arx(training.trials, training.labels, block_rows, identification.order)
    chosen = SUBSPACE_METHODS[method]
    return fit_subspace(training.trials, training.labels, chosen, block_rows, identification.order)


def _validation_run(training: TrainingSet, fitted: Fitted) -> ValidationRun:
    """Return the run on the trial with the most validation rows."""
    fit_on, validate_on = split_trials(training.trials)
    longest = int(np.argmax([len(u) for u, _ in validate_on]))
    u, y = validate_on[longest]
    with np.errstate(over="ignore", invalid="ignore"):  # an unstable model's
        simulated = simulate_on(fitted.first_rows, u, y, fitted.n_start)
    first_row = training.first_rows[longest] + len(fit_on[longest][0])
    return ValidationRun(training.labels[longest], first_row, fitted.n_start, y, simulated)


def _doubts(trainings: Sequence[Recording]) -> list[str]:
    """Return the doubts about recordings that the run does not play; those about its own are reported elsewhere."""
    left_out = [text for recording in trainings for text in recording.left_out]
    return left_out + [f"trained on {text}" for recording in trainings for text in recording.anomalies]


def _poor_fit(fit: SimulationFit, hand: Hand, training: TrainingSet, paper: bool) -> tuple[str, ...]:
    """Return a warning of a model that explains little of held-back rows."""
    # an axis at rest has nothing to explain but noise
    ranges_m = training.output_high_m - training.output_low_m
    moving = ranges_m >= _RESTING * ranges_m.max()
    if min(np.array(fit.fit_pct)[moving]) >= _POOR_FIT_PCT:
        return ()
    shares = " ".join(fit_text(share, 0) for share in fit.fit_pct)
    # The paper's method simulates badly even where the arm is the right one.
    reason = (
        "without measurements the model is of no use"
        if paper
        else f"it may not be the arm that follows the {hand} hand"
    )
    return (f"a simulation explains only {shares} % of {training.arm}'s x y z on the held-back rows: {reason}",)
