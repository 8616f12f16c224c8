"""Errors as a user reads them: ``where: field: rule (got value)``, all faults of an input at once.

Network facts (lost, late, undecodable, missed tick) are counted values and never appear here.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Final

_NOTHING: Final = object()
_LONGEST_VALUE = 80
_LONGEST_REASON = 200


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong: where (a file, a process), which field, the rule it breaks and the value."""

    where: str
    field: str
    rule: str
    got: object = _NOTHING

    def __str__(self) -> str:
        head = ": ".join(part for part in (self.where, self.field, self.rule) if part)
        if self.got is _NOTHING:
            return head
        value = repr(self.got)
        if len(value) > _LONGEST_VALUE:
            value = value[: _LONGEST_VALUE - 3] + "..."
        return f"{head} (got {value})"


def in_a_line(error: BaseException) -> str:
    """Return an exception of somebody else's code as one line of moderate length."""
    text = " ".join(str(error).split())
    said = f"{type(error).__name__}: {text}" if text else type(error).__name__
    return said if len(said) <= _LONGEST_REASON else f"{said[: _LONGEST_REASON - 3]}..."


class TisError(Exception):
    """Base of all errors that a user can mend; carries the exit code of the command."""

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


EXIT_OK = 0
EXIT_INVALID_RUN = 5
EXIT_LOSSY_RECOVERY = 3
EXIT_BUG = 70
EXIT_INTERRUPTED = 130
