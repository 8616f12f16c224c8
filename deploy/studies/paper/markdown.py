"""Numbers and tables of the page, as Markdown."""

from collections.abc import Iterable, Sequence


def axes_text(values: Iterable[float | None], digits: int = 2) -> str:
    """Return one number for each axis; a dash for an unknown one, powers of ten for those of a diverged filter."""
    return " ".join("-" if v is None else f"{v:.{digits}f}" if abs(v) < 1e4 else f"{v:.0e}" for v in values)


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table with texts to the left."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(str(value) for value in row) + " |" for row in rows]
    return "\n".join(lines)
