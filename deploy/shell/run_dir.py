"""Folder of a run: names of its files, atomic writes, scenario and manifest."""

import hashlib
import importlib.metadata
import json
import os
import platform
import subprocess
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from pydantic_core import from_json

from tis.common.channels import Side
from tis.common.errors import DataError, Fault, file_faults
from tis.common.estimators import ESTIMATORS, scenario_name
from tis.common.runtime.run_folders import RUNS
from tis.common.runtime.scenario_files import read_limited
from tis.common.scenario import Scenario
from tis.common.scenario import reading as scenario_io
from tis.common.sources.provenance import MODEL_FILES
from tis.common.yaml_text import MAX_YAML_BYTES

SCENARIO_FILE: Final = "scenario.yaml"
NETWORK_FILE: Final = "network.yaml"
SUMMARY_FILE: Final = "summary.json"
MANIFEST_FILE: Final = "manifest.json"
REPORT_FILE: Final = "report.html"
MERGED_FILE: Final = "run.mcap"
MAX_JSON_BYTES: Final = 8_000_000
"""Size of a summary or manifest, which take some 0.1 MB; as Python objects JSON takes up to 25 times its size."""

_LIBRARIES: Final = ("tis-testbed", "eclipse-zenoh", "numpy", "scipy", "filterpy", "mcap", "msgspec", "pydantic")


def create(path: Path, scenario: Scenario) -> Path:
    """Create a run folder with its scenario; raises `DataError` when it is not empty or cannot be written."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        if any(path.iterdir()):
            raise DataError(Fault(str(path), "", "run folder must be new or empty: give another --run-dir"))
    except OSError as error:
        raise DataError(
            Fault(str(path), "", f"run folder cannot be created: {error.strerror}; give another --run-dir")
        ) from None
    try:
        write(path / SCENARIO_FILE, scenario_io.dump_scenario(scenario))
    except DataError:
        with suppress(OSError):
            path.rmdir()
        raise
    return path


def model_file(run_dir: Path) -> Path:
    """Return the file of a run's models, whether it is there or not."""
    paths = [run_dir / name for name in MODEL_FILES]
    return next((path for path in paths if path.is_file()), paths[0])


def page_file(name: str) -> Path:
    """Return a page's default file below runs/, a folder that `write` makes."""
    return RUNS / name


def made(path: Path) -> Path:
    """Return a folder after making it, if it is not there; raises `DataError`."""
    with file_faults(path, "folder cannot be created"):
        path.mkdir(parents=True, exist_ok=True)
    return path


def remove_unused(path: Path) -> None:
    """Delete a run folder in which no side started running, so that a user's mistake leaves nothing behind."""
    for file in path.iterdir():
        file.unlink()
    path.rmdir()
    if path.parent == RUNS:
        with suppress(OSError):  # other runs are there
            RUNS.rmdir()


def write(path: Path, content: str | bytes) -> None:
    """Write a file atomically, by a temporary file and a rename; raises `DataError`."""
    if path.parent == RUNS:
        made(RUNS)
    partial: Path | None = None
    try:
        with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
            partial = Path(file.name)
            file.write(content.encode() if isinstance(content, str) else content)
        partial.chmod(0o644)  # a temporary file is private, a result is not
        partial.replace(path)
    except OSError as error:
        raise DataError(Fault(str(path), "", f"cannot be written: {error.strerror}")) from None
    finally:
        if partial is not None:
            partial.unlink(missing_ok=True)


def remove(path: Path) -> None:
    """Delete a file, if it is there; raises `DataError`."""
    with file_faults(path, "cannot be deleted"):
        path.unlink(missing_ok=True)


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a JSON file atomically; raises `DataError`."""
    write(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def manifest(
    run_dir: Path,
    command: str,
    mode: str,
    exit_codes: Mapping[Side, int],
    clocks: Mapping[Side, Mapping[str, Any]] | None = None,
    own: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Return the provenance of a run: command, versions, host, exit codes and hashes of its files.

    ``clocks`` holds each side's host clock and its discipline (adjtimex), ``own`` the origins of user-defined
    estimators.
    """
    # report and merged logs can be rewritten at any time, even by another version
    unlisted = (MANIFEST_FILE, REPORT_FILE, MERGED_FILE)
    files = sorted(path for path in run_dir.iterdir() if path.is_file() and path.name not in unlisted)
    return {
        "command": command,
        "mode": mode,
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
        "python": platform.python_version(),
        "versions": {name: _version(name) for name in _LIBRARIES},
        "git_revision": _git_revision(),
        "host": {
            "system": platform.platform(),
            "machine": platform.machine(),
            "cpus": os.cpu_count(),
            "load_average": list(os.getloadavg()),
        },
        "clocks": {side: dict(clock) for side, clock in (clocks or {}).items()},
        "own_estimators": dict(own or {}),
        "exit_codes": dict(exit_codes),
        "sha256": {path.name: _sha256(path) for path in files},
    }


def read_scenario(run_dir: Path, fallback: str | None = None) -> Scenario:
    """Return the scenario of a run folder, or of ``fallback`` (YAML) when the folder has no scenario file.

    Raises `DataError` when it is not a run folder, `InputError` when the scenario is invalid.
    """
    path = run_dir / SCENARIO_FILE
    if not run_dir.is_dir():
        rule = "is a file, not the folder of a run" if run_dir.exists() else "does not exist"
        raise DataError(Fault(str(run_dir), "", rule))
    try:
        text = fallback if fallback is not None and not path.exists() else _scenario_text(path)
    except (OSError, UnicodeDecodeError):
        raise DataError(
            Fault(
                str(run_dir),
                "",
                f"is no run folder: it holds no readable {SCENARIO_FILE}; tis runs lists those below a folder",
            )
        ) from None
    return scenario_io.build_scenario(_as_now(scenario_io.parse_yaml(text, str(path))), str(path))


def _as_now(raw: Mapping[str, Any]) -> dict[str, Any]:
    """Return the scenario of a run that an earlier version may have made, in the words of this one."""
    found = dict(raw)
    if isinstance(names := found.get("estimators"), list):
        found["estimators"] = [_estimator_now(name) for name in names]
    if "active_estimator" in found:
        found["active_estimator"] = _estimator_now(found["active_estimator"])
    source = found.get("source")
    if isinstance(source, dict) and source.get("kind") == "jigsaws":
        found["source"] = {"clock": "as_recorded", **source}  # before there was a choice
    return found


def _estimator_now(name: Any) -> Any:
    return scenario_name(name) if isinstance(name, str) and name in ESTIMATORS else name


def _scenario_text(path: Path) -> str:
    return read_limited(path, MAX_YAML_BYTES).decode("utf-8")


def read_json(path: Path) -> dict[str, Any] | None:
    """Return a JSON file's content, None without the file; raises `DataError` when it cannot be read."""
    if not path.is_file():
        return None
    try:
        content = from_json(read_limited(path, MAX_JSON_BYTES), allow_inf_nan=False)
    except OSError as error:
        raise DataError(Fault(str(path), "", f"cannot be read: {error.strerror}")) from None
    except ValueError:
        raise DataError(Fault(str(path), "", "is not readable JSON")) from None
    if not isinstance(content, dict):
        raise DataError(Fault(str(path), "", "must be a JSON object"))
    return content


def _sha256(path: Path) -> str:
    with path.open("rb") as file:  # in chunks: logs may be large
        return hashlib.file_digest(file, "sha256").hexdigest()


def _version(name: str) -> str | None:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def _git_revision() -> str | None:
    """Return the checkout's revision, with a + when it has uncommitted changes; None outside a checkout."""
    here = Path(__file__).parent
    try:
        head = _git(here, "rev-parse", "HEAD")
        return head + ("+" if _git(here, "status", "--porcelain", "--untracked-files=no") else "")
    except (OSError, subprocess.SubprocessError):
        return None


def _git(here: Path, *words: str) -> str:
    done = subprocess.run(
        ["git", "-C", str(here), *words],  # noqa: S607
        capture_output=True,
        text=True,
        check=True,
        timeout=5,
    )
    return done.stdout.strip()


def texts_in(value: object) -> tuple[str, ...]:
    """Return the texts in a list of a file that `read_json` returned, which anybody may have written."""
    return tuple(text for text in value if isinstance(text, str)) if isinstance(value, list) else ()
