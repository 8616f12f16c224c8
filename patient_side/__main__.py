"""The patient's process: ``python -m patient_side SCENARIO`` or ``tis patient SCENARIO``."""

import time
from dataclasses import replace
from pathlib import Path

import typer

from common.errors import DataError, Fault
from common.runtime.client_side import run_client_side
from common.runtime.recordings import load_recording, load_training
from common.runtime.side import Prepared, SideOptions
from common.runtime.side_cli import endpoints_for, side_command
from common.runtime.status import Status
from common.scenario import Scenario
from common.sources.provenance import RECORDING_FILE, dump_played
from common.sources.trajectory import Recording
from patient_side.build import build_patient, choose_models, identify_models
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


def run_patient(scenario: Scenario, options: SideOptions, status: Status) -> int:
    """Run the patient's side to its end; return the exit code."""
    connect = options.zenoh.connect or endpoints_for(scenario, "patient", "east")
    options = replace(options, zenoh=replace(options.zenoh, connect=connect))

    def prepare() -> Prepared:
        recording = load_recording(scenario)
        models = models_for(scenario, recording)
        node = build_patient(scenario, models, recording, time.perf_counter_ns)
        played = dump_played(recording, scenario.n_samples).encode()
        attachments = {MODEL_FILE: dump_models(models).encode(), RECORDING_FILE: played}
        return Prepared(node, attachments, warnings_at_start(scenario, recording, models))

    return run_client_side("patient", "east", scenario, options, prepare, status)


command = side_command("patient", run_patient)

if __name__ == "__main__":
    typer.run(command)
