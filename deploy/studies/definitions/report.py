"""Tables of `tis compare --definitions`, for a terminal and as Markdown."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from typing import Any, Final

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from tis.deploy.compare.cells.forecasts import ErrorSums
from tis.deploy.compare.engine.compute import Outcome
from tis.deploy.compare.plan import Plan
from tis.deploy.compare.results.tables import markdown_table
from tis.deploy.studies.definitions.published import PUBLISHED, Published
from tis.deploy.studies.definitions.readings import (
    ERROR_WORDS,
    HORIZONS_S,
    NAMES,
    READINGS,
    SPAN_WORDS,
    SPLIT_WORDS,
    SPLITS,
    Reading,
    value_mm,
)
from tis.deploy.studies.definitions.velocity_inputs import Inputs

# Report of `tis compare --definitions` as plain values: our figures by reading, beside the published ones.

OURS: Final = NAMES[-1]
_AT_HORIZON: Final = Reading("rmse_3d", "at")


def build(
    plan: Plan, outcome: Outcome, least_squares: Mapping[Inputs, ErrorSums | None], command: str
) -> dict[str, Any]:
    """Return the report: rows of readings, least squares with and without velocities, published figures."""
    rows = _report_rows(plan, outcome)
    return {
        "command": command,
        "trials": list(plan.trials),
        "people": sorted({trial[0] for trial in plan.trials}),
        "horizons_s": list(HORIZONS_S),
        "rows": rows,
        "least_squares": [
            {"rate_hz": inputs.rate_hz, "velocity": inputs.velocity, "mm": _by_horizon(sums, _AT_HORIZON)}
            for inputs, sums in least_squares.items()
            if sums is not None and sums.n
        ],
        "published": [beside(each, rows) for each in PUBLISHED],
        "missing": [split for split in SPLITS if not any(row["split"] == split for row in rows)],
        "failed": [f"{failure.label}: {failure.reason}" for failure in outcome.failures]
        + [str(fault) for fault in plan.refused],
    }


def _report_rows(plan: Plan, outcome: Outcome) -> list[dict[str, Any]]:
    """Return a row for each split with forecasts and each reading, numbered from 1."""
    rows: list[dict[str, Any]] = []
    for split in SPLITS:
        found = [outcome.cells[cell.digest] for cell in plan.cells if cell.setting == split
                 and cell.digest in outcome.cells]  # fmt: skip
        sums = {name: _pooled(found, name) for name in NAMES}
        known = {name: each for name, each in sums.items() if each is not None and each.n}
        if len(known) < len(NAMES):
            continue
        rows += [
            {
                "row": len(rows) + number,
                "split": split,
                "error": reading.error,
                "span": reading.span,
                "n_trials": len(found),
                "n_forecasts": known[OURS].n,
                "mm": {name: _by_horizon(each, reading) for name, each in known.items()},
            }
            for number, reading in enumerate(READINGS, start=1)
        ]
    return rows


def _pooled(results: Sequence[Mapping[str, Any]], name: str) -> ErrorSums | None:
    """Return the sums over all twins and both arms."""
    return ErrorSums.total(
        ErrorSums.from_json(by_name[name]) for result in results for by_name in result["forecasts"].values()
    )


def _by_horizon(sums: ErrorSums, reading: Reading) -> list[float]:
    return [value_mm(sums, reading, horizon_s) for horizon_s in HORIZONS_S]


def beside(published: Published, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return a published figure with the rows that its text allows, our range over them, and the verdict."""
    fitting = [
        row
        for row in rows
        if published.mm is not None
        and row["error"] in published.errors
        and row["span"] in published.spans
        and row["split"] in published.splits
    ]
    ours: dict[str, list[float]] = {}
    if fitting and published.horizon_s is not None:
        at = HORIZONS_S.index(published.horizon_s)
        for name in NAMES:
            values = [row["mm"][name][at] for row in fitting]
            ours[name] = [min(values), max(values)]
    return {
        "name": published.name,
        "figure": published.figure,
        "mm": published.mm,
        "horizon_s": published.horizon_s,
        "rows": [row["row"] for row in fitting],
        "ours_mm": ours,
        "verdict": verdict(published, len(fitting)),
        "says": published.says,
        "leaves_open": list(published.leaves_open),
        "citation": published.citation,
        "read": published.read,
    }


def verdict(published: Published, n_fitting: int) -> str:
    """Return ``comparable``, or ``not comparable, because ...``: one reading must be left, and no difference."""
    reasons = list(published.differs)
    if published.mm is not None and n_fitting == 0:
        reasons.append("there is no row of ours that its text allows")
    if published.mm is not None and n_fitting > 1:
        reasons.append(f"the text that was read allows {n_fitting} rows")
    if published.leaves_open:
        reasons.append(f"it leaves open: {', '.join(published.leaves_open)}")
    return "not comparable, because " + "; ".join(reasons) if reasons else "comparable"


def standing(entry: Mapping[str, Any]) -> str:
    """Return where a published figure is relative to the range of ours; empty for one that is no distance.

    Ours are rounded to the published figures' hundredths of a mm: nothing closer can be told.
    """
    if not entry["ours_mm"]:
        return ""
    low, high = (round(mm, 2) for mm in entry["ours_mm"][OURS])
    if entry["mm"] < low:
        return "below the range of"
    return "above the range of" if entry["mm"] > high else "within the range of"


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
