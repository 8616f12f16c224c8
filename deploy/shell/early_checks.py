"""Checks of a command before it computes for minutes: writable output files, installed optional packages."""

import errno
import os
import tempfile
from importlib.util import find_spec
from pathlib import Path

from tis.common.errors import DataError, Fault
from tis.common.runtime.run_folders import RUNS


def unwritable(*files: Path | None) -> list[Fault]:
    """Return a fault for each file that `tis.deploy.shell.run_dir.write` could not write; leaves no file behind.

    None stands for an option without a value. Oracle: `write` itself, tests/deploy/shell/test_early_checks.
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


def check_outputs_in(folder: Path, *names: str) -> None:
    """Raise `DataError` with all files of a folder that are not writable; one that is not there is made later."""
    if folder.exists():
        check_outputs(*(folder / name for name in names))


def _reason(file: Path) -> str | None:
    if file.is_dir():
        return os.strerror(errno.EISDIR)
    try:
        lacks = file.parent == RUNS and not RUNS.exists()  # `write` makes it
        with tempfile.TemporaryFile(dir=RUNS.parent if lacks else file.parent):
            return None
    except OSError as error:
        return error.strerror


def can_report() -> bool:
    """Tell whether Bokeh, which draws the report and the live page, is installed."""
    return find_spec("bokeh") is not None


def can_ssh() -> bool:
    """Tell whether the package asyncssh, which reaches hosts of `tis up` by ssh, is installed."""
    return find_spec("asyncssh") is not None


def can_certify() -> bool:
    """Tell whether the package cryptography, which makes certificates, is installed."""
    return find_spec("cryptography") is not None
