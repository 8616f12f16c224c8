"""Warnings of many twins for a reader: those of one kind in one line, those that change what was scored first."""

import re
from collections.abc import Sequence
from typing import Final

_MINOR: Final = re.compile(r"it has no columns of |has no (gripper|orientation)|trained without .* other columns")
"""What follows from the layout of tables that was asked for, and says nothing of a single one."""
_MOST_NAMED: Final = 6
_TRAINED_ON: Final = "trained on "
_BOTH: Final = "scored and as training data of others"


def notices(texts: Sequence[str], most: int, file: str) -> list[str]:
    """Return at most ``most`` lines for the warnings; the last one tells how many more ``file`` has.

    A warning reads ``SUBJECT: TEXT``; those with one text are a line with all subjects. Where the texts differ in
    numbers alone the first is told, and whom the others concern. A warning that concerns a trial twice, as scored and
    as one that others are trained on, is told once, with both. Oracle: literals, test_notices.
    """
    kinds: dict[tuple[str, str], dict[str, str]] = {}
    given = set(texts)
    for text in texts:
        role = _role(text, given)
        if role == _BOTH and text.startswith(_TRAINED_ON):
            continue
        subject, colon, rest = text.partition(": ")
        rest = rest if colon else ""
        subject = subject.removeprefix(_TRAINED_ON) if role == _TRAINED_ON else subject
        kind = re.sub(r"s\b", "", re.sub(r"[\d.]+", "#", rest))  # a number's noun may be plural
        kinds.setdefault((role, kind or text), {}).setdefault(subject, rest)
    lines = [_line(role, found) for (role, _), found in kinds.items()]
    lines.sort(key=lambda line: bool(_MINOR.search(line)))
    more = len(lines) - most
    return lines if more <= 0 else [*lines[:most], f"and {more} more, in {file}"]


def _role(text: str, given: set[str]) -> str:
    """Return what a warning's subject is to the scores: scored (""), trained on, or both."""
    if _TRAINED_ON + text in given or (text.startswith(_TRAINED_ON) and text.removeprefix(_TRAINED_ON) in given):
        return _BOTH
    return _TRAINED_ON if text.startswith(_TRAINED_ON) and ": " in text else ""


def _line(role: str, found: dict[str, str]) -> str:
    before, after = role if role == _TRAINED_ON else "", f", {_BOTH}" if role == _BOTH else ""
    subjects, (first, *others) = list(found), list(found.values())
    if not first:
        return before + subjects[0]
    if all(other == first for other in others):
        return f"{before}{_named(subjects)}{after}: {first}"
    return f"{before}{subjects[0]}{after}: {first}; likewise {_named(subjects[1:])}"


def _named(names: Sequence[str]) -> str:
    rest = len(names) - _MOST_NAMED
    return ", ".join(names[:_MOST_NAMED]) + (f" and {rest} more" if rest > 0 else "")
