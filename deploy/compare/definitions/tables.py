"""Tables of `tis compare --definitions`, for a terminal and as Markdown."""

from collections.abc import Iterable, Sequence
from itertools import groupby
from typing import Any, Final

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from tis.deploy.compare.definitions.readings import ERROR_WORDS, SPAN_WORDS
from tis.deploy.compare.definitions.report import standing
from tis.deploy.compare.definitions.splits import NAMES, SPLIT_WORDS
from tis.deploy.compare.results.tables import markdown_table

CAPTION: Final = (
    f"mm, each cell: {NAMES[0]}, then {NAMES[1]}; both arms pooled. An axis: the mean over x, y and z. Up to it: "
    "over all steps from the first to the horizon. Where only the horizon counts, 30 and 10 Hz are the same."
)


def view(report: dict[str, Any]) -> RenderableType:
    """Return the report for a terminal: our readings, the least squares, and the published figures."""
    parts: list[RenderableType] = [Text(headline(report), style="bold")]
    for split, rows in groupby(report["rows"], lambda row: row["split"]):
        parts += [Text(f"\nTrained with {SPLIT_WORDS[split]}"), _table(_head(report), map(_reading_cells, rows))]
    parts.append(Text(f"\n{CAPTION}", style="dim"))
    if report["least_squares"]:
        parts += [Text("\nLeast squares, one user out, 3D RMSE at the horizon, mm")]
        parts.append(_table(_squares_head(report), map(_squares_cells, report["least_squares"])))
    parts.append(Text("\nPublished, and our range over the rows that its text allows, mm"))
    parts.append(_table(("published", "figure", "rows", *NAMES), map(_published_cells, report["published"])))
    parts += [Text(f"\n{entry['name']}: {_sentence(entry)}") for entry in report["published"]]
    return Group(*parts)


def headline(report: dict[str, Any]) -> str:
    """Return trials and people as a sentence."""
    n_trials, n_people = len(report["trials"]), len(report["people"])
    missing = "".join(f" No figure with {SPLIT_WORDS[split]}: it needs other trials." for split in report["missing"])
    return f"{n_trials} trials of {n_people} people: {', '.join(report['trials'])}.{missing}"


def readings_markdown(report: dict[str, Any]) -> str:
    """Return all rows of readings as one Markdown table, the split in a column."""
    head = ("row", "trained with", *_head(report)[1:])
    rows = []
    for row in report["rows"]:
        number, *cells = _reading_cells(row)
        rows.append((number, SPLIT_WORDS[row["split"]], *cells))
    return markdown_table(head, rows)


def squares_markdown(report: dict[str, Any]) -> str:
    """Return the least squares with and without velocities."""
    return markdown_table(_squares_head(report), map(_squares_cells, report["least_squares"]))


def published_markdown(report: dict[str, Any]) -> str:
    """Return the published figures with rows, range, standing and verdict."""
    head = ("published", "figure", "rows", *(f"`{name}`" for name in NAMES), "the figure is", "verdict")
    rows = [(*_published_cells(entry), _standing(entry), entry["verdict"]) for entry in report["published"]]
    return markdown_table(head, rows)


def _standing(entry: dict[str, Any]) -> str:
    where = standing(entry)
    return f"{where} `{NAMES[1]}`" if where else "-"


def _sentence(entry: dict[str, Any]) -> str:
    where = standing(entry)
    return f"{entry['verdict']}." + (f" The figure is {where} {NAMES[1]}." if where else "")


def _head(report: dict[str, Any]) -> tuple[str, ...]:
    return ("row", "reading", *_horizons(report))


def _squares_head(report: dict[str, Any]) -> tuple[str, ...]:
    return ("past", *_horizons(report))


def _horizons(report: dict[str, Any]) -> list[str]:
    return [f"{horizon:g} s" for horizon in report["horizons_s"]]


def _reading_cells(row: dict[str, Any]) -> tuple[str, ...]:
    columns = zip(*(row["mm"][name] for name in NAMES), strict=True)
    reading = f"{ERROR_WORDS[row['error']]}, {SPAN_WORDS[row['span']]}"
    return (str(row["row"]), reading, *(" ".join(map(_mm, column)) for column in columns))


def _squares_cells(row: dict[str, Any]) -> tuple[str, ...]:
    inputs = "positions and velocity" if row["velocity"] else "positions"
    return (f"{inputs}, {row['rate_hz']} Hz", *map(_mm, row["mm"]))


def _published_cells(entry: dict[str, Any]) -> tuple[str, ...]:
    ranges = [entry["ours_mm"].get(name) for name in NAMES]
    words = ("-" if each is None else f"{_mm(each[0])} to {_mm(each[1])}" for each in ranges)
    return (entry["name"], entry["figure"], _numbers(entry["rows"]), *words)


def _numbers(rows: Sequence[int]) -> str:
    """Return the numbers of rows as ranges, like 1-12."""
    ranges: list[list[int]] = []
    for row in rows:
        if ranges and row == ranges[-1][1] + 1:
            ranges[-1][1] = row
        else:
            ranges.append([row, row])
    return ", ".join(f"{low}" if low == high else f"{low}-{high}" for low, high in ranges) or "none"


def _mm(value: float) -> str:
    return f"{value:.2f}" if value < 10 else f"{value:.1f}"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, padding=(0, 0, 0, 0))
    for i, name in enumerate(head):
        table.add_column(name, justify="left" if i < 2 else "right", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    return table
