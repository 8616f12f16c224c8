"""The models and the own estimators that a scenario names: read from files, identified from recordings, imported."""

from collections.abc import Mapping
from pathlib import Path

from common.errors import DataError, Fault
from common.runtime.code_origin import Origin
from common.runtime.recordings import load_training
from common.runtime.user_code import UserCode, load_user_code
from common.scenario import Scenario
from common.scenario.estimator_names import is_user_defined
from common.sources.trajectory import Recording
from patient_side.build import choose_models, identify_models
from patient_side.estimators.guarded import Factories
from patient_side.identification.model_io import parse_models
from patient_side.statespace import ArmModel

MODEL_FILE = "model.json"


def read_models(path: Path) -> tuple[ArmModel, ...]:
    """Read a model file; raises `DataError`."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise DataError(Fault(str(path), "", f"model file cannot be read: {reason}")) from None
    return parse_models(text, str(path))


def models_for(scenario: Scenario, recording: Recording) -> tuple[ArmModel, ...]:
    """Read or identify the models that the scenario asks for; raises `DataError`."""
    train = scenario.identification.train
    if train.endswith(".json"):
        return choose_models(scenario, read_models(Path(train)), train, recording)
    return identify_models(scenario, recording, load_training(scenario, recording))


def own_estimators(scenario: Scenario) -> dict[str, UserCode]:
    """Load the code of the user's own estimators that the scenario names; raises `InputError` with all faults."""
    return load_user_code([name for name in scenario.estimators if is_user_defined(name)], "estimators")


def factories(own: Mapping[str, UserCode]) -> Factories:
    """Return what builds each of the user's own estimators."""
    return {name: code.factory for name, code in own.items()}


def origins(own: Mapping[str, UserCode]) -> dict[str, Origin]:
    """Return where each of the user's own estimators came from."""
    return {name: code.origin for name, code in own.items()}
