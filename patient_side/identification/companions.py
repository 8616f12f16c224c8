"""Models for estimators with an identification method of their own, beside the scenario's chosen model."""

from collections.abc import Callable, Collection
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from typing import Final, TypeVar, get_args

from tis.common.errors import DataError
from tis.common.scenario.estimator_names import EstimatorName, LearnedName, is_user_defined
from tis.common.scenario.identification import Identification
from tis.patient_side.identification.arx import fit_arx
from tis.patient_side.identification.dataset import TrainingSet
from tis.patient_side.identification.direct_ls import fit_direct
from tis.patient_side.identification.fit_drmf import fit_drmf
from tis.patient_side.identification.fit_innovations import fit_autoregression, fit_innovations
from tis.patient_side.identification.fit_wrist import fit_wrist
from tis.patient_side.identification.moesp_paper import fit_moesp_paper
from tis.patient_side.identification.order import Fitted
from tis.patient_side.identification.subspace_methods import SUBSPACE_METHODS, fit_subspace
from tis.patient_side.movement_models import CompletionModel, DirectModel, InnovationsModel, WristModel
from tis.patient_side.statespace import FilterModel

Model = TypeVar("Model")

_ON_INNOVATIONS: Final[tuple[EstimatorName, ...]] = ("innovations_kf", "adaptive_kf", *get_args(LearnedName))

Stage = Callable[[str], AbstractContextManager[None]]
"""Context in which the model for an estimator, or an orientation method, is fitted."""


def untimed(_: str) -> AbstractContextManager[None]:
    """Return a context without effect."""
    return nullcontext()


@dataclass(frozen=True)
class Companions:
    """The fields of `ArmModel` of the same names; None where they are not wanted, or the rows do not allow them."""

    innovations: InnovationsModel | None = None
    n4sid: FilterModel | None = None
    arx: FilterModel | None = None
    autoregression: InnovationsModel | None = None
    direct: DirectModel | None = None
    paper: FilterModel | None = None
    drmf: CompletionModel | None = None
    wrist: WristModel | None = None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Attempts:
    """Fits for the estimators ``wanted`` (None: all), with a warning for each optional one that fails."""

    wanted: Collection[str] | None
    stage: Stage
    warnings: list[str] = field(default_factory=list)

    def fit(self, name: EstimatorName, fit: Callable[[], Model], *, slow: bool = False) -> Model | None:
        """Return the model for an estimator; raises `DataError` where it is wanted and cannot be fitted.

        A ``slow`` fit, of several seconds, is not tried for user-defined estimators.
        """
        if self.wanted is not None and name in self.wanted:
            with self.stage(name):
                return fit()
        # A user-defined estimator may use any model, so all are tried for it.
        if self.wanted is not None and (slow or not any(map(is_user_defined, self.wanted))):
            return None
        try:
            with self.stage(name):
                return fit()
        except DataError as error:
            self.warnings.append(f"no model for {name}: {'; '.join(map(str, error.faults))}")
            return None


def fit_companions(
    training: TrainingSet,
    identification: Identification,
    wanted: Collection[str] | None,
    about_lowest: Callable[[], TrainingSet] | None = None,
    stage: Stage = untimed,
) -> Companions:
    """Return the models for the estimators and orientation methods ``wanted`` (None: all), from a set about the mean.

    Their orders are the validated ones, up to the scenario's number of block rows. The paper's model, whose order
    follows its own rule, is fitted to the set ``about_lowest``; None where the scenario's own method is the paper's.
    A wanted model that cannot be fitted is a `DataError`, an optional one a warning; for a user-defined estimator all
    models are optional. ``stage`` measures each fit.
    """
    attempts, block_rows = _Attempts(wanted, stage), identification.block_rows

    def innovations() -> InnovationsModel:
        grippers_rad, people = training.grippers_rad, training.people
        fitted = fit_innovations(training.trials, training.rate_hz, block_rows, None, grippers_rad, people)
        attempts.warnings.extend(fitted.warnings)
        return fitted.model

    # The order of the fits is that of the warnings.
    paper = None
    if about_lowest is not None:
        user: EstimatorName = "paper" if wanted is None or "paper" in wanted else "paper_as_printed"
        paper = attempts.fit(user, lambda: _paper_model(about_lowest(), identification))
    arx = attempts.fit("arx_kf", lambda: _filter_model(training, fit_arx(training, block_rows, "auto")))
    autoregression = None
    if arx is not None and arx.space.order == 0:
        with stage("arx_kf"):
            autoregression = fit_autoregression(training.trials, training.rate_hz, block_rows)
    n4sid = SUBSPACE_METHODS["n4sid"]
    wrist, doubts = fit_wrist(training, wanted, stage)
    attempts.warnings.extend(doubts)
    moving: EstimatorName = "innovations_kf"
    if wanted is not None:  # its other users share the model, and a fit is attempted under the name of one
        moving = next((name for name in _ON_INNOVATIONS if name in wanted), moving)
    return Companions(
        attempts.fit(moving, innovations),
        attempts.fit("n4sid_kf", lambda: _filter_model(training, fit_subspace(training, n4sid, block_rows, "auto"))),
        arx,
        autoregression,
        attempts.fit("direct_ls", lambda: fit_direct([y for _, y in training.trials], training.rate_hz)),
        paper,
        attempts.fit(
            "drmf",
            lambda: fit_drmf([y for _, y in training.trials], training.rate_hz, training.people),
            slow=True,
        ),
        wrist,
        tuple(attempts.warnings),
    )


def _paper_model(training: TrainingSet, identification: Identification) -> FilterModel:
    return _filter_model(training, fit_moesp_paper(training, identification.model_copy(update={"order": "auto"})))


def _filter_model(training: TrainingSet, fitted: Fitted) -> FilterModel:
    return FilterModel(fitted.space, fitted.noise, training.input_offset_m, training.output_offset_m, fitted.static)
