"""Syntax check of Zenoh key expressions, like demo/** and */measured_$*, without Zenoh."""

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
