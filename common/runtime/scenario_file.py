"""A scenario's file, and the folder of its run."""

import re
import time
from pathlib import Path
from typing import Any, Final

from tis.common.errors import Fault, InputError
from tis.common.runtime.limited_file import read_limited
from tis.common.scenario import reading
from tis.common.yaml_text import MAX_YAML_BYTES

RUNS: Final = Path("runs")
"""Folder of the runs whose folder the user does not name."""
_MAX_FOLDERS: Final = 20


def read_scenario(path: Path) -> dict[str, Any]:
    """Return a scenario file's top-level mapping, not validated yet; raises `InputError`."""
    try:
        text = read_limited(path, MAX_YAML_BYTES).decode("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise InputError(Fault(str(path), "", f"cannot be read: {reason}")) from None
    return reading.parse_yaml(text, str(path))


def run_folder(base: Path, name: str) -> Path:
    """Return a new folder's name below ``base``: the date, the time and the scenario."""
    stamp = time.strftime("%Y%m%d_%H%M%S")
    path, n = base / f"{stamp}_{name}", 1
    while path.exists():
        n += 1
        path = base / f"{stamp}_{name}_{n}"
    return path


def latest_folders(base: Path, name: str) -> list[Path]:
    """Return the newest folders that `run_folder` has named for a scenario, newest first, and at most twenty."""
    ours = re.compile(rf"[0-9]{{8}}_[0-9]{{6}}_{re.escape(name)}(_[0-9]+)?")
    try:
        found = [path for path in base.iterdir() if ours.fullmatch(path.name)]
    except OSError:
        return []
    return sorted(found, reverse=True)[:_MAX_FOLDERS]
