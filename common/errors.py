"""User-facing errors: ``where: field: rule (got value)``, all faults of an input at once; and the exit codes.

Network events (lost, late, undecodable, missed tick) are counted values and never errors.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import PurePath
from traceback import walk_tb
from typing import ClassVar, Final

_NO_VALUE: Final = object()  # None is a value that a field can have
_MAX_VALUE_CHARS = 80
_MAX_REASON_CHARS = 200
MAX_SHOWN: Final = 5
"""Faults of a kind that are shown."""


@dataclass(frozen=True)
class Fault:
    """One broken rule: where (a file, a process, an option), the field, the rule and the value."""

    where: str
    field: str
    rule: str
    got: object = _NO_VALUE

    def __str__(self) -> str:
        head = ": ".join(part for part in (self.where, self.field, self.rule) if part)
        if self.got is _NO_VALUE:
            return head
        value = repr(self.got)
        if len(value) > _MAX_VALUE_CHARS:
            value = value[: _MAX_VALUE_CHARS - 3] + "..."
        return f"{head} (got {value})"


def printable(text: str) -> str:
    """Return a text of others without what would steer a terminal."""
    return "".join(each if each.isprintable() else "?" for each in text)


def capped(found: Sequence[Fault], count: int, where: str, rule: str, what: str = "rows") -> list[Fault]:
    """Return the first `MAX_SHOWN` faults of a kind, and one that counts the other rows, or ``what`` they are."""
    shown = list(found[:MAX_SHOWN])
    if count > len(shown):
        shown.append(Fault(where, f"and {count - len(shown)} more {what}", rule))
    return shown


def one_line(error: BaseException) -> str:
    """Return an exception of foreign code as one line of limited length."""
    text = " ".join(str(error).split())
    line = f"{type(error).__name__}: {text}" if text else type(error).__name__
    return line if len(line) <= _MAX_REASON_CHARS else f"{line[: _MAX_REASON_CHARS - 3]}..."


def place_of(error: BaseException, *ours: str) -> str:
    """Return the line of a user's code that an exception came through, like " (my_filter.py, line 3)"; "" if unknown.

    It is the last one in the folder of the first file that is none of ``ours``, as a library may have raised.
    """
    lines = [(PurePath(frame.f_code.co_filename), line) for frame, line in walk_tb(error.__traceback__)]
    theirs = [one for one in lines if not str(one[0]).startswith("<frozen") and str(one[0]) not in ours]
    own = [(file, line) for file, line in theirs if file.parent == theirs[0][0].parent]
    return f" ({own[-1][0].name}, line {own[-1][1]})" if own else ""


CURE: Final = " -> "
"""Stands between a problem and what to do about it."""


def problem(text: str, cure: str) -> str:
    """Return a problem of a run with what to do about it, as summary, brief and report show it."""
    return f"{text}{CURE}{cure}"


class TisError(Exception):
    """Base of all errors that a user can correct; carries the exit code of the command."""

    exit_code: ClassVar[int] = 70

    def __init__(self, faults: Fault | Sequence[Fault]) -> None:
        self.faults = (faults,) if isinstance(faults, Fault) else tuple(faults)
        super().__init__("\n".join(str(fault) for fault in self.faults))


class InputError(TisError):
    """A scenario, an option or an address that cannot be used."""

    exit_code = 2


class PeerError(TisError):
    """A peer, a child process or the barrier failed."""

    exit_code = 3


class DataError(TisError):
    """A recording, a model file, a log or the disk cannot be used."""

    exit_code = 4


@contextmanager
def file_faults(where: object, rule: str) -> Iterator[None]:
    """Raise `DataError` where the block's work on a file fails: the rule, and the system's reason."""
    try:
        yield
    except OSError as error:
        raise DataError(Fault(str(where), "", f"{rule}: {error.strerror}")) from None


EXIT_OK = 0
EXIT_INVALID_RUN = 5
EXIT_LOSSY_RECOVERY = 3
EXIT_BUG = 70
EXIT_INTERRUPTED = 130
