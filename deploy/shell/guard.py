"""The consoles of the command line, what is printed to them, the guard around its commands, and early checks."""

import errno
import json
import os
import tempfile
from collections.abc import Callable, Sequence
from functools import wraps
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, ParamSpec

import typer
from rich.console import Console
from rich.markup import escape

from tis.common.errors import DataError, Fault
from tis.common.runtime.process import guarded_exit_code, line_of
from tis.common.runtime.run_folders import RUNS


def version_text() -> str:
    """Return both versions, as `tis --version` prints them."""
    return f"tis {version('tis-testbed')}, eclipse-zenoh {version('eclipse-zenoh')}"


def print_warnings(err: Console, *texts: str) -> None:
    """Print a yellow line for each warning."""
    for text in texts:
        err.print(escape(f"warning: {text}"), style="yellow", soft_wrap=True)


def print_faults(err: Console, *texts: str) -> None:
    """Print a red line for each fault."""
    for text in texts:
        err.print(escape(f"tis: {text}"), style="red", soft_wrap=True)


def print_json(data: Any) -> None:
    """Print data to standard output, for other programs."""
    print(json.dumps(data, indent=1, allow_nan=False))  # noqa: T201


# without emoji: they would replace a part of a name such as module:X:
class _QuietConsole(Console):
    """Standard error for warnings and errors, which have a colour; all else is dropped."""

    def print(self, *objects: Any, style: Any = None, **options: Any) -> None:
        """Print what is yellow or red."""
        if style in _TOLD:
            super().print(*objects, style=style, **options)


_TOLD: Final = ("yellow", "red")
QUIET: Final = _QuietConsole(stderr=True, highlight=False, emoji=False, force_terminal=False)  # and so no panel


class WholeConsole(Console):
    """A console that cuts nothing which goes to a pipe or a file: a table is as wide there as its cells are."""

    cuts_nothing = True

    def print(self, *objects: Any, **options: Any) -> None:
        """Print, cropped to the width of a terminal only."""
        super().print(*objects, **{"crop": self.is_terminal} | options)


OUT: Final = WholeConsole(highlight=False, emoji=False)
ERR: Final = WholeConsole(stderr=True, highlight=False, emoji=False)

P = ParamSpec("P")


def words_to(as_json: bool) -> Console:
    """Return the console for words: standard error when standard output is for data."""
    return ERR if as_json else OUT


def guarded(command: Callable[P, int]) -> Callable[P, None]:
    """Turn errors into one line each and an exit code; a bug keeps its traceback."""

    @wraps(command)
    def ending(*args: P.args, **kwargs: P.kwargs) -> None:
        raise typer.Exit(guarded_exit_code("tis", lambda: command(*args, **kwargs), _print_faults))

    return ending


def _print_faults(_: int, faults: Sequence[Fault]) -> None:
    for fault in faults:
        ERR.print(escape(line_of("tis", fault)), style="red", soft_wrap=True)


# Checks of a command before it computes for minutes: writable output files, installed optional packages.


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
