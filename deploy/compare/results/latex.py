"""The ratios of a comparison as a LaTeX table, for papers: `booktabs`, numbers with their intervals."""

from collections.abc import Sequence
from typing import Any, Final

from tis.deploy.compare.results.tables import ratios

_COMMANDS: Final = {
    "\\": r"\textbackslash{}",
    "^": r"\textasciicircum{}",
    "~": r"\textasciitilde{}",
    "×": r"$\times$",
    "µ": r"$\mu$",
    "²": r"$^2$",
}
_SPECIAL: Final = str.maketrans({**{char: f"\\{char}" for char in "&%$#_{}"}, **_COMMANDS})


def latex_table(report: dict[str, Any]) -> str:
    """Return a ``tabular`` of the ratios to hold, the command in a comment above it."""
    head, rows = ratios(report)
    # A command that is longer than a line stays a comment.
    command = " ".join(report["command"].split())
    n_text = len(report["axes"]) if len(report["axes"]) > 1 else 1
    about = (f"% {command}", "% RMSE in 3D over that of hold, with 95 % bootstrap intervals over people")
    return tabular(head, rows, *about, n_text=n_text)


def tabular(head: Sequence[str], rows: Sequence[Sequence[str]], *comments: str, n_text: int = 1) -> str:
    """Return a ``tabular`` in the style of `booktabs`, comments above it; the first ``n_text`` columns are texts."""
    lines = [
        *comments,
        rf"\begin{{tabular}}{{{'l' * n_text}{'r' * (len(head) - n_text)}}}",
        r"\toprule",
        _line(head),
        r"\midrule",
        *map(_line, rows),
        r"\bottomrule",
        r"\end{tabular}",
    ]
    return "\n".join(lines) + "\n"


def _line(cells: Sequence[str]) -> str:
    return " & ".join(cell.translate(_SPECIAL) for cell in cells) + r" \\"
