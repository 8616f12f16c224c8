"""Faults of what a side needs on its host, found before anything starts."""

import os
import socket
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from tis.common.channels import Side
from tis.common.errors import Fault, TisError
from tis.common.runtime.credentials import credentials
from tis.common.runtime.recordings import check_recording, located
from tis.common.runtime.scenario_files import load_traces
from tis.common.scenario import Hosts, reading
from tis.common.scenario.identification import is_model_file
from tis.patient_side.models import own_estimators, read_models
from tis.patient_side.plant.physics import check_plant


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
        found += _not_free(scenario.hosts)
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


def _not_free(hosts: Hosts | Literal["auto"]) -> list[Fault]:
    """Return the endpoints of TCP on which netem could not listen."""
    found = []
    for endpoint in () if hosts == "auto" else hosts.endpoints:
        protocol, _, address = endpoint.partition("?")[0].partition("#")[0].partition("/")
        host, _, port = address.rpartition(":")
        if protocol not in ("tcp", "tls"):
            continue
        try:
            family = socket.AF_INET6 if ":" in host else socket.AF_INET
            socket.create_server((host.strip("[]"), int(port)), family=family).close()
        except (OSError, OverflowError) as error:
            found.append(Fault(endpoint, "", f"cannot be listened on: {getattr(error, 'strerror', None) or error}"))
    return found
