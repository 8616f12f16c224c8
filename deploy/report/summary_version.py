"""Checks of ``summary.json``, which anybody may have written: reports need every name, and values of their kinds."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from tis.common.errors import DataError, Fault, one_line
from tis.common.scenario import Scenario
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.report.summary import build_summary

_NO_SUCH_VALUE: Final = (LookupError, TypeError, ValueError, AttributeError, OverflowError)
"""Exceptions of a table or page that a value of another kind than expected can cause."""


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """Raise `DataError` when what is made of a summary within the block fails: it holds a value of another kind."""
    try:
        yield
    except _NO_SUCH_VALUE as error:
        raise DataError(Fault(str(path), "", f"cannot be shown ({one_line(error)}); see tis summarize")) from None


def check_version(summary: Mapping[str, Any], path: Path, scenario: Scenario) -> None:
    """Raise `DataError` when a summary lacks a name that every summary of this version has.

    Names that depend on the run, as of estimators and keys, are not checked.
    """
    expected = build_summary(RunLogs(path.parent), scenario, (), "live", None, "")  # without logs: fast
    absent = sorted(_absent(expected, summary))
    if absent:
        shown = ", ".join(absent[:6]) + (f" and {len(absent) - 6} more" if len(absent) > 6 else "")
        raise DataError(Fault(str(path), "", f"is no summary of this version: it has no {shown}; see tis summarize"))


def _absent(expected: Mapping[str, Any], found: Any, place: str = "") -> Iterator[str]:
    for name, value in expected.items():
        here = f"{place}{name}"
        if not isinstance(found, Mapping) or name not in found:
            yield here
        elif isinstance(value, Mapping):
            yield from _absent(value, found[name], f"{here}.")
        elif isinstance(value, list) and not isinstance(found[name], list):
            yield here
