"""Folders of runs, named by date, time and scenario."""

import re
import time
from pathlib import Path
from typing import Final

RUNS: Final = Path("runs")
"""Folder of the runs whose folder the user does not name."""
_MAX_FOLDERS: Final = 20


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
