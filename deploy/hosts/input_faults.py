"""Faults of what a side needs on its host, found before anything starts."""

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

from tis.common.channels import Side
from tis.common.errors import Fault, TisError
from tis.common.runtime.credentials import credentials
from tis.common.runtime.recordings import check_recording, located
from tis.common.runtime.scenario_files import load_traces
from tis.common.scenario import reading
from tis.common.scenario.identification import is_model_file
from tis.patient_side.models import own_estimators, read_models
from tis.patient_side.plant.extra import check_plant


def input_faults(side: Side, text: str) -> list[Fault]:
    """Return the faults of a scenario, else of the current folder and of the files that a side needs of it.

    Certificates and passwords, recordings, model, traces and own estimators, each only where this side reads it.
    """
    try:
        scenario = reading.build_scenario(reading.parse_yaml(text, "scenario"), "scenario")
    except TisError as error:
        return list(error.faults)
    found = _unwritable(Path.cwd())
    steps: list[Callable[[], object]] = [lambda: credentials(scenario.security, side)]
    if side == "netem":
        steps.append(lambda: load_traces(scenario.network))
    else:
        steps.append(lambda: check_recording(located(scenario)))
    if side == "patient":
        identification = scenario.identification
        steps.append(lambda: identification.check_for_live_runs(scenario.estimators))
        steps.append(lambda: own_estimators(scenario))
        steps.append(lambda: check_plant(scenario))
        if is_model_file(scenario.identification.train):
            steps.append(lambda: read_models(Path(scenario.identification.train)))
    for step in steps:
        try:
            step()
        except TisError as error:
            found += error.faults
    return found


def _unwritable(folder: Path) -> list[Fault]:
    try:
        with tempfile.TemporaryFile(dir=folder):
            return []
    except OSError as error:
        return [Fault(str(folder), "", f"cannot be written: {error.strerror or os.strerror(error.errno or 0)}")]
