"""Environment of a Python child process, so that it imports the same packages as this process."""

import os
from pathlib import Path
from typing import Final

PACKAGES: Final = str(Path(__file__).resolve().parents[2])
"""The folder that holds the testbed's packages."""


def child_environment() -> dict[str, str]:
    """Return this process's environment, with the folder of the testbed's packages first on PYTHONPATH.

    PYTHONSAFEPATH keeps ``python -m`` from putting the current folder before it: a package there that is called
    ``common`` or ``deploy`` would replace the testbed's. Oracle: `tests/common/runtime/test_child_process`, children
    in folders without the packages and with others of their names.
    """
    paths = [PACKAGES, os.environ.get("PYTHONPATH", "")]
    return {**os.environ, "PYTHONSAFEPATH": "1", "PYTHONPATH": os.pathsep.join(path for path in paths if path)}
