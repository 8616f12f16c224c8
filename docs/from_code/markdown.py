"""Markdown of the generated pages: escaped text and tables."""

import re
from collections.abc import Iterable, Sequence
from typing import Final

UNITS = {
    "ns": "ns", "us": "µs", "ms": "ms", "s": "s", "hz": "Hz", "mm": "mm", "m": "m", "rad": "rad", "deg": "°",
    "pct": "%", "ppm": "ppm", "mb": "MB", "bytes": "bytes", "min": "1/min",
}  # fmt: skip
"""Units by the last word of a name."""

_CODE = re.compile(r"(``.+?``|`.+?`)")


_SPEEDS: Final = ("_m_s", "_mm_s", "_deg_s")


def unit_of(name: str) -> str:
    """Return the unit that a name ends with; "" where it names none."""
    head, _, last = name.rpartition("_")
    if name.endswith("_per_s"):
        return f"{head.removesuffix('_per').rpartition('_')[2]}/s"
    if name.endswith(_SPEEDS):
        return f"{head.rpartition('_')[2]}/s"
    return UNITS.get(last, "") if head else ""


def prose(text: str) -> str:
    """Return a docstring or a description as one line of Markdown; code between backticks stays as it is."""
    pieces = _CODE.split(" ".join(text.split()))
    return "".join(piece if _CODE.fullmatch(piece) else re.sub(r"([*<|\[\]])", r"\\\1", piece) for piece in pieces)


def code(text: object) -> str:
    """Return a value as code; nothing for nothing."""
    return f"`{text}`".replace("|", "\\|") if f"{text}" else ""


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table; columns that are empty in every row are left out."""
    body = list(rows)
    kept = [k for k in range(len(heads)) if any(row[k] for row in body)]
    lines = [[heads[k] for k in kept], ["---"] * len(kept), *([row[k] for k in kept] for row in body)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
