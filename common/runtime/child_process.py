"""Environment of a Python child process, so that it imports the same packages as this process."""

import os
from pathlib import Path
from typing import Final

import tis

PACKAGES: Final = str(Path(tis.__file__).parents[1])
"""The folder that holds the package ``tis``."""


def child_environment() -> dict[str, str]:
    """Return this process's environment, in which ``python -m`` does not put the current folder on the path.

    A module there that has the name of one of ours or of a library would replace it. The testbed's own folder is not
    put on the path either: in a checkout it holds packages of common names. Oracle:
    `tests/common/runtime/test_child_process`, children in folders with packages of those names.
    """
    return {**os.environ, "PYTHONSAFEPATH": "1"}
