"""Models for estimators that go by a method of their own, beside the one that the scenario asks for."""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import TypeVar

from common.errors import DataError
from common.scenario.estimator_names import EstimatorName, is_user_defined
from common.scenario.patient import Identification
from patient_side.identification.dataset import TrainingSet
from patient_side.identification.direct_ls import fit_direct
from patient_side.identification.fit_arx import fit_arx
from patient_side.identification.fit_autoregression import fit_autoregression
from patient_side.identification.fit_innovations import fit_innovations
from patient_side.identification.fit_moesp_paper import fit_moesp_paper
from patient_side.identification.fit_subspace import fit_subspace
from patient_side.identification.fitted import Fitted
from patient_side.identification.methods import SUBSPACE_METHODS
from patient_side.statespace import DirectModel, FilterModel, InnovationsModel

Model = TypeVar("Model")


@dataclass(frozen=True)
class Companions:
    """The fields of `ArmModel` of the same names; None where nobody wants them, or the rows do not allow them."""

    innovations: InnovationsModel | None = None
    n4sid: FilterModel | None = None
    arx: FilterModel | None = None
    autoregression: InnovationsModel | None = None
    direct: DirectModel | None = None
    paper: FilterModel | None = None
    warnings: tuple[str, ...] = ()


def fit_companions(
    training: TrainingSet,
    identification: Identification,
    wanted: Collection[str] | None,
    about_lowest: Callable[[], TrainingSet] | None = None,
) -> Companions:
    """Return the models that the estimators ``wanted`` need, of a training set about the mean; of None, all.

    Their orders are the validated ones, up to the scenario's number of block rows. The paper's model, whose order is
    that of its own rule, is found on the set ``about_lowest`` where there is one: where the scenario's own method is
    the paper's, there is none. What an estimator needs that is
    wanted and cannot be had is a `DataError`; of None, a warning. A user's own estimator gets what can be had of all.
    """
    block_rows, warnings = identification.block_rows, list[str]()
    everything = wanted is None or any(map(is_user_defined, wanted))

    def tried(name: EstimatorName, fit: Callable[[], Model]) -> Model | None:
        if wanted is not None and name in wanted:
            return fit()
        if not everything:
            return None
        try:
            return fit()
        except DataError as error:
            warnings.append(f"no model for {name}: {'; '.join(map(str, error.faults))}")
            return None

    def n4sid() -> FilterModel:
        return _filter_model(training, fit_subspace(training, SUBSPACE_METHODS["n4sid"], block_rows, "auto"))

    def arx() -> FilterModel:
        return _filter_model(training, fit_arx(training, block_rows, "auto"))

    def innovations() -> InnovationsModel:
        fitted = fit_innovations(training.trials, training.rate_hz, block_rows, grippers_rad=training.grippers_rad)
        warnings.extend(fitted.warnings)
        return fitted.model

    def paper(lowest: Callable[[], TrainingSet]) -> FilterModel:
        about = lowest()
        return _filter_model(about, fit_moesp_paper(about, identification.model_copy(update={"order": "auto"})))

    found_paper = None
    if about_lowest is not None:
        as_printed: EstimatorName = "paper" if wanted is None or "paper" in wanted else "paper_as_printed"
        found_paper = tried(as_printed, lambda: paper(about_lowest))
    found_arx = tried("arx_kf", arx)
    autoregression = None
    if found_arx is not None and found_arx.space.order == 0:
        autoregression = fit_autoregression(training.trials, training.rate_hz, block_rows)
    return Companions(
        tried("innovations_kf", innovations),
        tried("n4sid_kf", n4sid),
        found_arx,
        autoregression,
        tried("direct_ls", lambda: fit_direct([y for _, y in training.trials], training.rate_hz)),
        found_paper,
        tuple(warnings),
    )


def _filter_model(training: TrainingSet, fitted: Fitted) -> FilterModel:
    return FilterModel(fitted.space, fitted.noise, training.input_offset_m, training.output_offset_m, fitted.static)
