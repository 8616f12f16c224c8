"""A scenario's file, and the folder of its run."""

import time
from pathlib import Path
from typing import Any

from common.errors import Fault, InputError
from common.runtime.limited_file import read_limited
from common.scenario import reading
from common.scenario.yaml_text import MAX_YAML_BYTES


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
