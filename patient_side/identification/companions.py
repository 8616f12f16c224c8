"""Models for estimators with an identification method of their own, beside the scenario's chosen model."""

from collections.abc import Callable, Collection, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from tis.common.errors import DataError
from tis.common.estimators import ESTIMATORS, short_name, users_of_fit
from tis.common.scenario.estimator_names import is_user_defined
from tis.common.scenario.identification import Identification
from tis.patient_side.identification.arx import fit_arx
from tis.patient_side.identification.dataset import TrainingSet
from tis.patient_side.identification.direct_ls import fit_direct
from tis.patient_side.identification.fit_drmf import fit_drmf
from tis.patient_side.identification.fit_innovations import fit_autoregression, fit_innovations
from tis.patient_side.identification.moesp_paper import fit_moesp_paper
from tis.patient_side.identification.order import Fitted
from tis.patient_side.identification.subspace_methods import SUBSPACE_METHODS, fit_subspace
from tis.patient_side.movement_models import WristModel
from tis.patient_side.rotations import turned
from tis.patient_side.statespace import FilterModel

# Identification of the models of an arm's orientation and gripper.


def fit_wrist(
    training: TrainingSet, wanted: Collection[str] | None, stage: Callable[[str], AbstractContextManager[None]]
) -> tuple[WristModel | None, tuple[str, ...]]:
    """Return the models for the orientation methods ``wanted`` (None: all), and warnings; None: none is wanted.

    Trials too short for least squares give no such model and a warning: the answers then hold the orientation.
    ``stage`` measures each fit.
    """
    orientations, rate_hz = training.orientations, training.rate_hz
    grippers = [angles[:, None] for angles in training.grippers_rad]
    if wanted is not None and "tangent_ls" not in wanted:
        return None, ()
    try:
        with stage("tangent_ls"):
            direct = fit_direct(orientations, rate_hz, turned)
            return WristModel(direct, fit_direct(grippers, rate_hz)), ()
    except DataError as error:
        return None, (f"no model for tangent_ls: {'; '.join(map(str, error.faults))}",)


Stage = Callable[[str], AbstractContextManager[None]]
"""Context in which the model for an estimator, or an orientation method, is fitted."""


def untimed(_: str) -> AbstractContextManager[None]:
    """Return a context without effect."""
    return nullcontext()


@dataclass(frozen=True)
class TrainingRows:
    """What models are fitted to; ``about_lowest`` is None where the scenario's own method is the paper's.

    ``static``: a gain is the whole relation of arm and command.
    """

    training: TrainingSet
    identification: Identification
    about_lowest: Callable[[], TrainingSet] | None = None
    static: bool = True


class Companions(NamedTuple):
    """Models by the field of `ArmModel`, without those that are not wanted or that the rows do not allow."""

    models: Mapping[str, Any]
    warnings: tuple[str, ...] = ()


NO_MODELS = Companions({})


def fit_paper(rows: TrainingRows) -> Companions:
    """Return the paper's model, unless it is the scenario's own."""
    if rows.about_lowest is None:
        return NO_MODELS
    training = rows.about_lowest()
    fitted = fit_moesp_paper(training, rows.identification.model_copy(update={"order": "auto"}))
    return Companions({"paper": _filter_model(training, fitted)})


def fit_arx_models(rows: TrainingRows) -> Companions:
    """Return the model of ARX, and where validation chooses no lag the autoregression of the arm alone."""
    training, block_rows = rows.training, rows.identification.block_rows
    arx = _filter_model(training, fit_arx(training.trials, training.labels, block_rows, "auto"))
    if arx.space.order:
        return Companions({"arx": arx})
    alone = fit_autoregression(training.trials, training.rate_hz, block_rows)
    return Companions({"arx": arx, "autoregression": alone})


def fit_movement(rows: TrainingRows) -> Companions:
    """Return the innovations models of the arm's own movement, and of its command's where that is of more use."""
    training, block_rows = rows.training, rows.identification.block_rows
    fitted = fit_innovations(
        training.trials,
        training.rate_hz,
        block_rows,
        None,
        training.grippers_rad,
        training.people,
        training.orientations,
        training.others,
        follows=not rows.static,
    )
    return Companions({"innovations": fitted.model, "commanded": fitted.commanded}, fitted.warnings)


def fit_n4sid(rows: TrainingRows) -> Companions:
    """Return the model of N4SID."""
    method, block_rows = SUBSPACE_METHODS["n4sid"], rows.identification.block_rows
    training = rows.training
    return Companions(
        {"n4sid": _filter_model(training, fit_subspace(training.trials, training.labels, method, block_rows, "auto"))}
    )


def fit_horizons(rows: TrainingRows) -> Companions:
    """Return the regressions for each horizon."""
    return Companions({"direct": fit_direct([y for _, y in rows.training.trials], rows.training.rate_hz)})


def fit_completion(rows: TrainingRows) -> Companions:
    """Return the factorisation's numbers."""
    training = rows.training
    return Companions({"drmf": fit_drmf([y for _, y in training.trials], training.rate_hz, training.people)})


def _filter_model(training: TrainingSet, fitted: Fitted) -> FilterModel:
    return FilterModel(fitted.space, fitted.noise, training.input_offset_m, training.output_offset_m, fitted.static)


FITS: Final = (fit_paper, fit_arx_models, fit_movement, fit_n4sid, fit_horizons, fit_completion)
"""Fits that rows of `tis.common.estimators` name, in the order of their warnings in a model file."""


def fit_companions(
    training: TrainingSet,
    identification: Identification,
    wanted: Collection[str] | None,
    about_lowest: Callable[[], TrainingSet] | None = None,
    stage: Stage = untimed,
    *,
    static: bool = True,
) -> Companions:
    """Return the models for the estimators and orientation methods ``wanted`` (None: all), from a set about the mean.

    Their orders are the validated ones, up to the scenario's number of block rows. The paper's model, whose order
    follows its own rule, is fitted to the set ``about_lowest``; None where the scenario's own method is the paper's.
    The movement of the arm is that of its command, too, unless it is ``static``, a mere gain. A wanted model that
    cannot be fitted is a `DataError`; where all are wanted it is a warning. For a user-defined estimator all models
    are tried, without a warning: which of them it reads is not known. ``stage`` measures each fit.
    """
    rows = TrainingRows(training, identification, about_lowest, static)
    models: dict[str, Any] = {}
    warnings: list[str] = []
    wanted = None if wanted is None else set(map(short_name, wanted))
    # A user-defined estimator may use any model, so all that are not slow are tried for it.
    any_model = wanted is None or any(map(is_user_defined, wanted))
    owners = {row.fit: name for name, row in ESTIMATORS.items()}
    for fit in FITS:
        name = owners[fit.__name__]
        if fit is fit_movement:  # the warnings of orientations come before those of movements
            models["wrist"], doubts = fit_wrist(training, wanted, stage)
            warnings.extend(doubts)
        users = [user for user in users_of_fit(name) if wanted is not None and user in wanted]
        if not users and (not any_model or (ESTIMATORS[name].slow and wanted is not None)):
            continue
        user = users[0] if users else name  # a fit is attempted under the name of one of its users
        try:
            with stage(user):
                found = fit(rows)
        except DataError as error:
            if users:
                raise
            if wanted is None:
                warnings.append(f"no model for {user}: {'; '.join(map(str, error.faults))}")
            continue
        models |= found.models
        warnings.extend(found.warnings if users or wanted is None else ())
    return Companions(models, tuple(warnings))
