"""Warnings of many twins for a reader: those of one kind in one line, those that change what was scored first."""

import re
from collections.abc import Sequence
from typing import Final

_MINOR: Final = re.compile(r"it has no columns of |has no (gripper|orientation)|trained without .* other columns")
"""What follows from the layout of tables that was asked for, and says nothing of a single one."""
_MOST_NAMED: Final = 6


def notices(texts: Sequence[str], most: int, file: str) -> list[str]:
    """Return at most ``most`` lines for the warnings; the last one tells how many more ``file`` has.

    A warning reads ``SUBJECT: TEXT``; those with one text are a line with all subjects. Where the texts differ in
    numbers alone the first is told, and whom the others concern. Oracle: literals, test_notices.
    """
    kinds: dict[str, dict[str, str]] = {}
    for text in texts:
        subject, colon, rest = text.partition(": ")
        rest = rest if colon else ""
        kind = re.sub(r"s\b", "", re.sub(r"[\d.]+", "#", rest))  # a number's noun may be plural
        kinds.setdefault(kind or text, {}).setdefault(subject, rest)
    lines = [_line(found) for found in sorted(kinds.values(), key=lambda found: bool(_MINOR.search(_line(found))))]
    more = len(lines) - most
    return lines if more <= 0 else [*lines[:most], f"and {more} more, in {file}"]


def _line(found: dict[str, str]) -> str:
    subjects, (first, *others) = list(found), list(found.values())
    if not first or len(subjects) == 1:
        return ": ".join(filter(None, (subjects[0], first)))
    if all(other == first for other in others):
        return f"{_named(subjects)}: {first}"
    return f"{subjects[0]}: {first}; likewise {_named(subjects[1:])}"


def _named(names: Sequence[str]) -> str:
    rest = len(names) - _MOST_NAMED
    return ", ".join(names[:_MOST_NAMED]) + (f" and {rest} more" if rest > 0 else "")
