"""The patient's process: ``python -m patient_side SCENARIO`` or ``tis patient SCENARIO``."""

import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import typer

from common.errors import DataError, Fault
from common.runtime.client_side import run_client_side
from common.runtime.code_origin import OWN_CODE_FILE, Origin, dump_origins
from common.runtime.own_code import OwnCode, load_own
from common.runtime.recordings import load_recording, load_training
from common.runtime.side import Prepared, SideOptions
from common.runtime.side_cli import endpoints_for, side_command
from common.runtime.status import Status
from common.scenario import Scenario
from common.scenario.estimator_names import is_own
from common.sources.provenance import RECORDING_FILE, dump_played
from common.sources.trajectory import Recording
from patient_side.build import build_patient, choose_models, identify_models
from patient_side.estimators.guarded import Factories
from patient_side.identification.model_io import dump_models, parse_models
from patient_side.provenance import warnings_at_start
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


def own_estimators(scenario: Scenario) -> dict[str, OwnCode]:
    """Load the code of the user's own estimators that the scenario names; raises `InputError` with all faults."""
    return load_own([name for name in scenario.estimators if is_own(name)], "estimators")


def factories(own: Mapping[str, OwnCode]) -> Factories:
    """Return what builds each of the user's own estimators."""
    return {name: code.factory for name, code in own.items()}


def origins(own: Mapping[str, OwnCode]) -> dict[str, Origin]:
    """Return where each of the user's own estimators came from."""
    return {name: code.origin for name, code in own.items()}


def run_patient(scenario: Scenario, options: SideOptions, status: Status) -> int:
    """Run the patient's side to its end; return the exit code."""
    connect = options.zenoh.connect or endpoints_for(scenario, "patient", "east")
    options = replace(options, zenoh=replace(options.zenoh, connect=connect))

    def prepare() -> Prepared:
        own = own_estimators(scenario)  # what is wrong with them is said before anything takes time
        recording = load_recording(scenario)
        models = models_for(scenario, recording)
        node = build_patient(scenario, models, recording, time.perf_counter_ns, factories(own))
        played = dump_played(recording, scenario.n_samples).encode()
        attachments = {MODEL_FILE: dump_models(models).encode(), RECORDING_FILE: played}
        attachments |= {OWN_CODE_FILE: dump_origins(origins(own))} if own else {}
        return Prepared(node, attachments, warnings_at_start(scenario, recording, models))

    return run_client_side("patient", "east", scenario, options, prepare, status)


command = side_command("patient", run_patient)

if __name__ == "__main__":
    typer.run(command)
