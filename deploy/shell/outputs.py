"""Early check that a command's output files are writable, before it computes for minutes."""

import errno
import os
import tempfile
from pathlib import Path

from tis.common.errors import DataError, Fault


def unwritable(*files: Path | None) -> list[Fault]:
    """Return a fault for each file that `tis.deploy.shell.run_dir.write` could not write; leaves no file behind.

    None stands for an option without a value. Oracle: `write` itself, tests/deploy/shell/test_outputs.
    """
    return [
        Fault(str(file), "", f"cannot be written: {reason}")
        for file in files
        if file is not None and (reason := _reason(file)) is not None
    ]


def check_outputs(*files: Path | None) -> None:
    """Raise `DataError` with all files that are not writable."""
    faults = unwritable(*files)
    if faults:
        raise DataError(faults)


def _reason(file: Path) -> str | None:
    if file.is_dir():
        return os.strerror(errno.EISDIR)
    try:
        with tempfile.TemporaryFile(dir=file.parent):
            return None
    except OSError as error:
        return error.strerror
