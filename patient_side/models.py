"""A scenario's models, from files or recordings, and its user-defined estimators, imported from their modules."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from tis.common.errors import DataError, Fault
from tis.common.runtime.recordings import load_training
from tis.common.runtime.scenario_files import read_limited
from tis.common.runtime.user_code import Origin, UserCode, load_user_code
from tis.common.scenario import Scenario
from tis.common.scenario.estimator_names import is_user_defined
from tis.common.scenario.identification import is_model_file
from tis.common.sources.provenance import MODEL_FILES
from tis.common.sources.trajectory import Recording
from tis.patient_side.estimators.guarded import Factories
from tis.patient_side.statespace import ArmModel


def model_attachment(models: Sequence[ArmModel]) -> dict[str, bytes]:
    """Return the content of a run's model file by its name."""
    from tis.patient_side.identification.model_file import dump_models, is_tensor_file

    data = dump_models(models)
    return {MODEL_FILES[is_tensor_file(data)]: data}


def read_models(path: Path) -> tuple[ArmModel, ...]:
    """Read a model file; raises `DataError`."""
    from tis.patient_side.identification.model_file import MAX_MODEL_BYTES, parse_models

    try:
        data = read_limited(path, MAX_MODEL_BYTES)
    except OSError as error:
        raise DataError(Fault(str(path), "", f"model file cannot be read: {error.strerror}")) from None
    return parse_models(data, str(path))


def models_for(scenario: Scenario, recording: Recording) -> tuple[ArmModel, ...]:
    """Read or identify the scenario's models; raises `DataError`."""
    # imported late: `tis run` needs own estimators only, the patient's process loads filterpy
    from tis.patient_side.build import choose_models, identify_models

    train = scenario.identification.train
    if is_model_file(train):
        return choose_models(scenario, read_models(Path(train)), train, recording)
    return identify_models(scenario, recording, load_training(scenario, recording))


def own_estimators(scenario: Scenario) -> dict[str, UserCode]:
    """Load the code of the scenario's user-defined estimators; raises `InputError` with all faults."""
    return load_user_code([name for name in scenario.estimators if is_user_defined(name)], "estimators")


def factories(own: Mapping[str, UserCode]) -> Factories:
    """Return the factory of each user-defined estimator."""
    return {name: code.factory for name, code in own.items()}


def origins(own: Mapping[str, UserCode]) -> dict[str, Origin]:
    """Return the origin of each user-defined estimator's code."""
    return {name: code.origin for name, code in own.items()}
