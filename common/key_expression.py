"""Zenoh key expressions, like demo/** and */measured_$*, as far as they can be judged without Zenoh."""

from typing import Final

_WHOLE_CHUNKS: Final = ("*", "**")
_PART: Final = "$*"
_SPECIAL: Final = frozenset("*$#?")


def key_expression_fault(text: str) -> str | None:
    """Return the rule that a key expression breaks, None for one that Zenoh can be given, which makes it canonical.

    ``$*$*``, which means no more than ``$*``, is refused: Zenoh 1.10 may crash of it. Oracle: Zenoh,
    tests/common/test_key_expression.
    """
    chunks = text.split("/")
    if not all(chunks):
        return "must be a Zenoh key expression: no empty chunk, so no slash at its beginning or end"
    if any(_is_wrong(chunk) for chunk in chunks):
        return "must be a Zenoh key expression: *, ** as whole chunks, $* within one, and no other *, $, # or ?"
    return None


def _is_wrong(chunk: str) -> bool:
    if chunk in _WHOLE_CHUNKS:
        return False
    parts = chunk.split(_PART)
    return "" in parts[1:-1] or any(_SPECIAL.intersection(part) for part in parts)
