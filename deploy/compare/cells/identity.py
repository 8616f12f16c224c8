"""Identity of a training and a cell: the digest of everything that decides their results.

That is the scenario, the content of each file that is read, and the software.
"""

import hashlib
import importlib.metadata
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path
from typing import Any, Final, NamedTuple

import tis
from tis.common.errors import DataError, Fault
from tis.common.runtime.recordings import own_trial, person_of, trial_file, trials_of_others
from tis.common.runtime.scenario_files import trace_paths
from tis.common.runtime.user_code import UserCode
from tis.common.scenario import Scenario
from tis.common.scenario.identification import is_model_file
from tis.common.scenario.source import RecordedSource
from tis.common.sight.codec import codec_versions
from tis.deploy.compare.cells.cell import Cell, Training

_ROOT: Final = Path(tis.__file__).parent
_ALL_OF: Final = ("common", "surgeon_side", "netem", "patient_side")
_CELL: Final = "deploy/compare/cells/cell.py"
_SUMMARY: Final = "deploy/report/summarise.py"
_IMPORT: Final = re.compile(r"^from tis\.(deploy[\w.]*) import (\([^)]*\)|.+)", re.MULTILINE)
_LIBRARIES: Final = ("numpy", "scipy", "filterpy", "msgspec", "pydantic")
_IRRELEVANT_FIELDS: Final = ("name", "limits", "hosts", "security", "on_peer_loss", "peer_timeout_s", "on_log_loss")
"""Fields of a scenario without influence on a twin."""


def dump(scenario: Scenario) -> dict[str, Any]:
    """Return the scenario as a raw mapping; `build_scenario` is its inverse."""
    raw: dict[str, Any] = scenario.model_dump(mode="json", exclude_none=True)
    return raw


def training_of(scenario: Scenario) -> Training | None:
    """Return the training of a scenario, None for a model file; its digest covers only what decides the models."""
    train, source = scenario.identification.train, scenario.source
    if is_model_file(train):
        return None
    raw = dump(scenario)
    deciding: dict[str, Any] = {name: raw[name] for name in ("rate_hz", "identification", "estimators")}
    deciding["orientation"] = sorted(scenario.patient.orientation.in_order)
    kept = {name: value for name, value in raw["source"].items() if name not in ("path", "start", "trial")}
    if not isinstance(source, RecordedSource):
        deciding |= {"source": kept, "seed": scenario.seed}
        label = f"the head of seed {scenario.seed}"
    else:
        own = train == "own_head"
        played = own_trial(source)
        files = [played] if own else trials_of_others(source)
        deciding |= {"source": kept, "files": [trial_facts(trial_file(source, trial)).digest for trial in files]}
        label = f"the head of {played}" if own else f"all subjects but {person_of(source, played)}"
    if scenario.identification.sensor_noise_mm:
        deciding["seed"] = scenario.seed
    return Training(value_digest([software_digest(), deciding]), label, scenario)


def training_on(base: Training, trials: Sequence[str], label: str) -> Training:
    """Return the training of a scenario on these trials of its task instead of its own training data."""
    source = base.scenario.source
    assert isinstance(source, RecordedSource)
    digests = [trial_facts(trial_file(source, name)).digest for name in trials]
    return replace(base, digest=value_digest([base.digest, "trials", digests]), label=label, trials=tuple(trials))


def cell_of(
    scenario: Scenario, value: str | None, trial: str, training: Training | None, own: Mapping[str, UserCode]
) -> Cell:
    """Return a complete scenario as a cell; the trial's path and the scenario's name do not enter the digest.

    ``own`` is the code of user-defined estimators.
    """
    raw = {name: part for name, part in dump(scenario).items() if name not in _IRRELEVANT_FIELDS}
    raw["source"].pop("path", None)
    source, model_file = scenario.source, scenario.identification.train
    recorded = trial_file(source, own_trial(source)) if isinstance(source, RecordedSource) else None
    data = None if recorded is None else trial_facts(recorded).digest
    model = file_digest(Path(model_file)) if training is None else training.digest
    code = {name: asdict(own[name].origin) for name in scenario.estimators if name in own}
    traces = {path: file_digest(Path(path)) for path in trace_paths(scenario.network)}
    codec = [] if scenario.sight is None else [dict(codec_versions(scenario.sight.codec))]
    decided = value_digest([software_digest(), raw, data, model, code, *([traces] if traces else []), *codec])
    return Cell(decided, value, trial, scenario, None if training is None else training.digest)


def summarised(cell: Cell) -> Cell:
    """Return the cell whose result is its summary; the digest also covers the code that sums up."""
    return replace(cell, digest=value_digest([cell.digest, summary_digest()]), is_summarised=True)


class TrialFile(NamedTuple):
    """Digest of a trial's content, and its number of rows."""

    digest: str
    n_rows: int


def trial_facts(file: Path) -> TrialFile:
    """Return the facts of a trial without parsing it; a damaged one fails when its cell is computed."""
    found = file.stat()
    return _read_facts(file, found.st_mtime_ns, found.st_size)


@cache
def _read_facts(file: Path, mtime_ns: int, n_bytes: int) -> TrialFile:  # noqa: ARG001  cache keys: they change with the file
    content = file.read_bytes()
    return TrialFile(content_digest(content), sum(1 for line in content.splitlines() if line.strip()))


def value_digest(value: Any) -> str:
    """Return 16 hex digits of a JSON value, independent of the order of its keys."""
    return hashlib.blake2b(json.dumps(value, sort_keys=True).encode(), digest_size=8).hexdigest()


def content_digest(content: bytes) -> str:
    """Return 16 hex digits of bytes."""
    return hashlib.blake2b(content, digest_size=8).hexdigest()


def file_digest(file: Path) -> str:
    """Return 16 hex digits of a file's content, which is read again only after a change; raises `DataError`."""
    try:
        found = file.stat()
        if not file.is_file():
            raise DataError(Fault(str(file), "", "must be a file"))
        return _digest_of(file, found.st_mtime_ns, found.st_size)
    except (OSError, ValueError) as error:  # ValueError: an impossible path
        reason = error.strerror if isinstance(error, OSError) else error
        raise DataError(Fault(str(file), "", f"cannot be read: {reason}")) from None


@cache
def _digest_of(file: Path, mtime_ns: int, n_bytes: int) -> str:  # noqa: ARG001  cache keys: they change with the file
    return content_digest(file.read_bytes())


@cache
def software_digest() -> str:
    """Return 16 hex digits of all code behind a twin and its scores, and of the libraries' versions."""
    # In a checkout the packages are links, which ** does not follow below their parent.
    files = {str(file.relative_to(_ROOT)) for package in _ALL_OF for file in (_ROOT / package).glob("**/*.py")}
    versions = {name: importlib.metadata.version(name) for name in _LIBRARIES}
    return value_digest([_contents(files | _imported(_CELL)), versions])


@cache
def summary_digest() -> str:
    """Return 16 hex digits of the code that turns a twin's logs into a summary."""
    return value_digest(_contents(_imported(_SUMMARY)))


def _imported(file: str) -> set[str]:
    """Return a file of `tis.deploy` and those that it imports when it is loaded, and so on."""
    found: set[str] = set()
    new = [file]
    while new:
        found.add(one := new.pop())
        for module, names in _IMPORT.findall((_ROOT / one).read_text(encoding="utf-8")):
            place = module.replace(".", "/")
            each = (f"{place}.py", *(f"{place}/{name}.py" for name in re.findall(r"\w+", names)))
            new += [path for path in each if path not in found and (_ROOT / path).is_file()]
    return found


def _contents(files: Iterable[str]) -> dict[str, str]:
    """Return the digest of each file, by its path."""
    return {path: content_digest((_ROOT / path).read_bytes()) for path in sorted(files)}
