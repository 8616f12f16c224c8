"""Section on the figures in the paper's text, which no row of its tables has, beside ours."""

from collections.abc import Iterable, Sequence
from math import sqrt

from tis.deploy.paper.markdown import axes_text, table
from tis.deploy.paper.printed import ROWS, TEXT, PaperRow, PaperText
from tis.deploy.paper.results import Results, SimulationKey

Axis = float | None


def text_section(results: Results) -> str:
    """Return the section. Oracle: figures written by hand, test_text_section."""
    key = nearest_simulation(results)
    _, number, reading, _ = key
    ours = results.simulated[key].score
    row = min(ROWS, key=lambda each: _distance(each.accuracy_pct, TEXT.accuracy_pct))
    printed: list[tuple[str, PaperRow | PaperText]] = [
        ("the paper's text", TEXT),
        *((f"its table, row {each.number}", each) for each in ROWS),
    ]
    lines = [_line(name, each.accuracy_pct, each.rmse) for name, each in printed]
    lines.append(_line(f"ours, row {number} read as {reading}", ours["r2_pct"], ours["rmse_normalized"]))
    head = ("", "accuracy in %, x y z", "RMSE, x y z", "implied deviation, x y z")
    of_table = _distance(row.accuracy_pct, TEXT.accuracy_pct)
    of_ours = _distance(ours["r2_pct"], TEXT.accuracy_pct)
    low, high = _span_of_x(each for _, each in printed)
    return f"""## The figures in the paper's text

The section that describes the plots names no network. Its figures are in no row of the table: the nearest is
row {row.number}, which differs by up to {of_table:.2f} points of accuracy. Of our runs of Algorithm 1 on the
same-name pair that of row {number}, read as {reading}, is nearest to the text, within {of_ours:.2f} points;
`tis paper` draws it.

{table(head, lines)}

An accuracy that is R\u00b2 and a RMSE imply the deviation of the signal, RMSE / sqrt(1 - R\u00b2). On one trial it is
one number for each axis, whatever the network. What the paper prints implies {low:.3f} to {high:.3f} for x: its
rows and its text are not of one signal, or their accuracy is not R\u00b2 of the signal that the RMSE is of."""


def nearest_simulation(results: Results) -> SimulationKey:
    """Return the run of Algorithm 1 on the same-name pair whose accuracy is nearest to the text's on every axis."""
    own = [key for key in results.simulated if key[0] == "same_name" and not key[3]]
    return min(own, key=lambda key: _distance(results.simulated[key].score["r2_pct"], TEXT.accuracy_pct))


def implied_deviation(accuracy_pct: Sequence[Axis], rmse: Sequence[Axis]) -> list[Axis]:
    """Return the standard deviation of each axis that R\u00b2 in % and RMSE imply; None where one is unknown."""
    return [
        None if r2 is None or error is None or r2 >= 100 else error / sqrt(1 - r2 / 100)
        for r2, error in zip(accuracy_pct, rmse, strict=True)
    ]


def _line(name: str, accuracy_pct: Sequence[Axis], rmse: Sequence[Axis]) -> tuple[str, str, str, str]:
    implied = implied_deviation(accuracy_pct, rmse)
    return name, axes_text(accuracy_pct), axes_text(rmse, 4), axes_text(implied, 3)


def _span_of_x(printed: Iterable[PaperRow | PaperText]) -> tuple[float, float]:
    """Return the smallest and the largest deviation of x that printed figures imply."""
    found = [implied_deviation(each.accuracy_pct, each.rmse)[0] for each in printed]
    known = [value for value in found if value is not None]
    return min(known), max(known)


def _distance(ours: Sequence[Axis], theirs: Sequence[float]) -> float:
    """Return the largest difference over the axes; infinite where one of ours is unknown."""
    pairs = zip(ours, theirs, strict=True)
    return max(float("inf") if one is None else abs(one - other) for one, other in pairs)
