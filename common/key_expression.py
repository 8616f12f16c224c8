"""Syntax check of Zenoh key expressions, like demo/** and */measured_$*, without Zenoh."""

import re
from typing import Final

_WHOLE_CHUNKS: Final = ("*", "**")
_PART: Final = "$*"
_SPECIAL: Final = frozenset("*$#?")


def key_expression_fault(text: str) -> str | None:
    """Return the rule that a key expression breaks, None for one that Zenoh accepts and makes canonical.

    ``$*$*``, a synonym of ``$*``, is refused because it can crash Zenoh 1.10. Oracle: Zenoh, test_key_expression.
    """
    chunks = text.split("/")
    if not all(chunks):
        return "must be a Zenoh key expression: no empty chunk, and no slash at the beginning or end"
    if any(_is_wrong(chunk) for chunk in chunks):
        return "must be a Zenoh key expression: *, ** as whole chunks, $* within one, and no other *, $, # or ?"
    return None


def _is_wrong(chunk: str) -> bool:
    if chunk in _WHOLE_CHUNKS:
        return False
    parts = chunk.split(_PART)
    return "" in parts[1:-1] or any(_SPECIAL.intersection(part) for part in parts)


def key_matches(expression: str, key: str) -> bool:
    """Tell whether a key expression holds a key that has no wildcard. Oracle: Zenoh, test_key_expression."""
    if expression == key:
        return True
    if _WHOLE_CHUNKS[0] not in expression:
        return False
    return _chunks_match(expression.split("/"), key.split("/"))


def _chunks_match(expression: list[str], key: list[str]) -> bool:
    if not expression:
        return not key
    first, rest = expression[0], expression[1:]
    if first == _WHOLE_CHUNKS[1]:
        hidden = next((i for i, chunk in enumerate(key) if chunk.startswith("@")), len(key))
        return any(_chunks_match(rest, key[n:]) for n in range(hidden + 1))
    if not key:
        return False
    if first == _WHOLE_CHUNKS[0]:
        return not key[0].startswith("@") and _chunks_match(rest, key[1:])
    pattern = ".*".join(map(re.escape, first.split(_PART)))
    return re.fullmatch(pattern, key[0]) is not None and _chunks_match(rest, key[1:])
