"""Files that a unit of work reads, carried to a worker that shares no disk with the client.

The client names the files and reads them. The worker writes them below a folder of its own, and computes the unit
with the paths that they have there.
"""

import json
import os
import pickle
import shutil
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Lock
from typing import Any, Final

from tis.common.errors import InputError
from tis.common.runtime.recordings import list_trials, own_trial, trial_file
from tis.common.runtime.scenario_files import trace_paths
from tis.common.runtime.user_code import Origin, UserCode
from tis.common.scenario import Scenario
from tis.common.scenario.identification import is_model_file
from tis.common.scenario.reading import build_scenario
from tis.common.scenario.source import RecordedSource
from tis.deploy.compare.cells.cell import Cell
from tis.deploy.compare.cells.identity import dump, value_digest
from tis.deploy.compare.engine.workers import Computed, Failure, Result, Unit, perform
from tis.patient_side.models import own_estimators

_MODEL: Final = "model.json"
_TRIALS: Final = "trials"
_TRACES: Final = "traces"
_CODE: Final = "code"
_FILE_FIELDS: Final = ("path", "opportunities")
"""Fields of a network's stages that name a file."""
_ONE_AT_A_TIME: Final = Lock()
"""Held by the unit that a process computes: its threads would share recordings, models and loaded code."""


@dataclass(frozen=True)
class Shipment:
    """A unit, and what its worker must know: digests of its files by name, and the origins of its own estimators.

    ``home`` is the client's folder of trials, which messages name.
    """

    unit: Unit
    digests: Mapping[str, str]
    origins: Mapping[str, Origin]
    home: str


def shipped_files(unit: Unit, model_file: Path | None, own: Mapping[str, UserCode]) -> dict[str, Path]:
    """Return the files that a unit reads, by their names on the worker.

    A training on other people reads all trials of the task; a cell reads its own trial, its models and its traces.
    ``model_file`` holds the models of a cell's training, ``own`` the unit's `own_estimators`.
    """
    scenario = unit.scenario
    source, train = scenario.source, scenario.identification.train
    files: dict[str, Path] = {}
    if isinstance(source, RecordedSource):
        reads_all = not isinstance(unit, Cell) and train != "own_head"
        trials = list_trials(source) if reads_all else [own_trial(source)]
        files |= {f"{_TRIALS}/{trial}": trial_file(source, trial) for trial in trials}
    if is_model_file(train):
        files[_MODEL] = Path(train)
    elif model_file is not None:
        files[_MODEL] = model_file
    files |= {f"{_TRACES}/{i}": Path(path) for i, path in enumerate(trace_paths(scenario.network))}
    for name, code in own.items():
        files |= _code_files(name, code)
    return files


def shipment_of(unit: Unit, digests: Mapping[str, str], own: Mapping[str, UserCode]) -> Shipment:
    """Return a unit with the digests of its files."""
    source = unit.scenario.source
    home = ""
    if isinstance(source, RecordedSource):
        file = trial_file(source, own_trial(source))
        home = str(file.parents[3] if source.kind == "jigsaws" else file.parent)
    return Shipment(unit, digests, {name: code.origin for name, code in own.items()}, home)


def perform_away(packed: bytes, contents: Mapping[str, bytes], folder: str) -> Result:
    """Compute a pickled `Shipment` on a worker, from the ``contents`` of its files, which it writes below ``folder``.

    One unit is computed at a time in a process, whatever number of threads the worker has. Oracle: the same unit at
    home.
    """
    shipment: Shipment = pickle.loads(packed)  # noqa: S301  a Dask worker runs whatever its scheduler sends
    unit, root = shipment.unit, Path(folder)
    with _ONE_AT_A_TIME:
        try:
            there = _written(root, shipment, contents)
        except OSError as error:
            return Failure(unit.label, f"{root}: cannot be written: {error.strerror}")
        _offer_code(root, there / _CODE)
        if shipment.origins and (fault := _foreign_code(unit.scenario, shipment.origins)) is not None:
            return Failure(unit.label, fault)
        is_trained = isinstance(unit, Cell) and unit.training is not None
        result = perform(_placed(unit, there), there / _MODEL if is_trained else None)
    return _as_at_home(result, str(there / _TRIALS), shipment.home)


def _code_files(name: str, code: UserCode) -> dict[str, Path]:
    """Return the module of an own estimator and those beside it; a package must be installed on the workers."""
    module = sys.modules[name.partition(":")[0]]
    if "." in module.__name__ or module.__file__ is None or code.origin.distribution is not None:
        return {}
    folder = Path(module.__file__).parent
    names = {Path(module.__file__).name, code.origin.file or "", *code.origin.beside}
    return {f"{_CODE}/{name}": folder / name for name in sorted(names) if (folder / name).is_file()}


def _written(root: Path, shipment: Shipment, contents: Mapping[str, bytes]) -> Path:
    """Return the folder of a unit's files, which their digests name; each content is written once."""
    there = root / "units" / value_digest(dict(shipment.digests))
    if there.is_dir():
        return there
    kept = root / "contents"
    for folder in (kept, there.parent):
        folder.mkdir(parents=True, exist_ok=True)
    partial = Path(tempfile.mkdtemp(dir=there.parent))
    try:
        for name, content in contents.items():
            file = kept / shipment.digests[name]
            if not file.is_file():
                with tempfile.NamedTemporaryFile(dir=kept, delete=False) as whole:
                    whole.write(content)
                Path(whole.name).replace(file)
            place = _place(partial, shipment.unit.scenario, name)
            place.parent.mkdir(parents=True, exist_ok=True)
            os.link(file, place)
        partial.rename(there)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise
    return there


def _place(folder: Path, scenario: Scenario, name: str) -> Path:
    """Return the place of a file below the folder of its unit; trials lie as in the original distribution."""
    kind, _, trial = name.partition("/")
    if kind == _TRIALS:
        source = scenario.source
        assert isinstance(source, RecordedSource)
        return trial_file(source.model_copy(update={"path": _trials_path(source, folder)}), trial)
    return folder / name


def _trials_path(source: RecordedSource, folder: Path) -> str:
    """Return `source.path` below the folder of a unit: the folder of tasks, or the table itself."""
    trials = folder / _TRIALS
    return str(trials if source.kind == "jigsaws" else trials / own_trial(source))


def _placed(unit: Unit, there: Path) -> Unit:
    """Return the unit with the paths of its files on this worker."""
    raw = dump(unit.scenario)
    if isinstance(source := unit.scenario.source, RecordedSource):
        raw["source"]["path"] = _trials_path(source, there)
    if is_model_file(unit.scenario.identification.train):
        raw["identification"]["train"] = str(there / _MODEL)
    names = {path: str(there / _TRACES / str(i)) for i, path in enumerate(trace_paths(unit.scenario.network))}
    if names:
        raw["network"] = _renamed(raw["network"], names)
    return replace(unit, scenario=build_scenario(raw, unit.scenario.name))


def _renamed(value: Any, names: Mapping[str, str], field: str = "") -> Any:
    """Return a raw network whose files have other names."""
    if isinstance(value, dict):
        return {key: _renamed(part, names, key) for key, part in value.items()}
    if isinstance(value, list):
        return [_renamed(part, names) for part in value]
    return names.get(value, value) if field in _FILE_FIELDS else value


def _offer_code(root: Path, folder: Path) -> None:
    """Let Python import the code of this unit; what an earlier unit had imported from another folder is forgotten."""
    sys.path[:] = [path for path in sys.path if not Path(path).is_relative_to(root)]
    for name, module in list(sys.modules.items()):
        file = Path(getattr(module, "__file__", None) or "/")
        if file.is_relative_to(root) and not file.is_relative_to(folder):
            del sys.modules[name]
    if folder.is_dir():
        sys.path.insert(0, str(folder))


def _foreign_code(scenario: Scenario, origins: Mapping[str, Origin]) -> str | None:
    """Return in how far the own estimators found here differ from the client's; None if they do not."""
    try:
        found = own_estimators(scenario)
    except InputError as error:
        return "; ".join(f"{fault} on the worker" for fault in error.faults)
    for name, code in found.items():
        asked, here = origins[name], code.origin
        both = asked.beside.keys() & here.beside.keys()
        same = (asked.sha256, asked.version) == (here.sha256, here.version)
        if not same or any(asked.beside[file] != here.beside[file] for file in both):
            return f"{name}: the worker has another {here.file or 'module'}; install there what is installed here"
    return None


def _as_at_home(result: Result, folder: str, home: str) -> Result:
    """Return the result with the client's folder of trials in its texts."""
    if isinstance(result, Failure):
        return replace(result, reason=result.reason.replace(folder, home))
    text = json.dumps(result.result)
    if folder not in text:
        return result
    return Computed(json.loads(text.replace(folder, home)), result.models)
