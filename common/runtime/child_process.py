"""Environment of a Python child process, so that it imports the same packages as this process."""

import os
from pathlib import Path
from typing import Final

_PACKAGES: Final = Path(__file__).resolve().parents[2]


def child_environment() -> dict[str, str]:
    """Return this process's environment, with the folder of the testbed's packages first on PYTHONPATH.

    Oracle: `tests/common/runtime/test_child_process`, a child in a folder without the packages.
    """
    paths = [str(_PACKAGES), os.environ.get("PYTHONPATH", "")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in paths if path)}
