"""Report of `tis compare --definitions`: our figures by reading, beside the published ones; tables and page."""

from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, Final

from rich.console import Group, RenderableType
from rich.text import Text

from tis.deploy.compare.cells.forecasts import ErrorSums
from tis.deploy.compare.engine.compute import Outcome
from tis.deploy.compare.plan import Plan
from tis.deploy.present.numbers import NONE
from tis.deploy.present.table import TIGHT, Column, Table
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
    Split,
    value_mm,
)
from tis.deploy.studies.definitions.velocity_inputs import Inputs
from tis.deploy.studies.tables import filled

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
        found = of_split(plan, outcome, split)
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


def of_split(plan: Plan, outcome: Outcome, split: Split) -> list[dict[str, Any]]:
    """Return the results of a split's twins."""
    return [outcome.cells[cell.digest] for cell in plan.cells
            if cell.setting == split and cell.digest in outcome.cells]  # fmt: skip


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


_CAPTION: Final = (
    f"mm, each cell: {NAMES[0]}, then {NAMES[1]}; both arms pooled. An axis: the mean over x, y and z. Up to it: "
    "over all steps from the first to the horizon. Where only the horizon counts, 30 and 10 Hz are the same."
)


def view(report: Mapping[str, Any]) -> RenderableType:
    """Return the report for a terminal: our readings, the least squares, and the published figures."""
    parts: list[RenderableType] = [Text(_headline(report), style="bold")]
    for split, rows in groupby(report["rows"], lambda row: row["split"]):
        parts += [Text(f"\nTrained with {SPLIT_WORDS[split]}"), _readings(report, list(rows)).terminal(TIGHT)]
    parts.append(Text(f"\n{_CAPTION}", style="dim"))
    if report["least_squares"]:
        parts += [Text("\nLeast squares, one user out, 3D RMSE at the horizon, mm"), _squares(report).terminal(TIGHT)]
    if report["windows"]:
        parts += [Text("\n30 rows in, 10 out, one user out, RMSE and MAE of an axis, mm")]
        parts += [_windows(report).terminal(TIGHT)]
    parts.append(Text("\nPublished, and our range over the rows that its text allows, mm"))
    parts.append(_published(report).terminal(TIGHT))
    for entry in report["published"]:
        where = f" The figure is {standing(entry)} {NAMES[1]}." if standing(entry) else ""
        parts.append(Text(f"\n{entry['name']}: {entry['verdict']}.{where}"))
    return Group(*parts)


def page_text(report: Mapping[str, Any]) -> str:
    """Return the page ``docs/research/definitions.md``; no figure of ours in it is typed by hand."""
    return filled(
        Path(__file__).with_name("page.md"),
        command=report["command"],
        headline=_headline(report),
        readings=_readings(report, report["rows"], with_split=True).markdown(),
        squares=_squares(report).markdown(),
        windows=_windows(report).markdown(),
        published=_published(report, with_verdict=True).markdown(),
        said="\n\n".join(map(_said, report["published"])),
    )


def _headline(report: Mapping[str, Any]) -> str:
    """Return trials and people as a sentence."""
    n_trials, n_people = len(report["trials"]), len(report["people"])
    missing = "".join(f" No figure with {SPLIT_WORDS[split]}: it needs other trials." for split in report["missing"])
    return f"{n_trials} trials of {n_people} people: {', '.join(report['trials'])}.{missing}"


def _said(entry: Mapping[str, Any]) -> str:
    """Return what a publication says and leaves open."""
    says = (f"Says: {entry['says']}", f"Leaves open: {'; '.join(entry['leaves_open'])}", f"Read: {entry['read']}")
    items = "\n".join(f"- {text}." for text in (*says, entry["citation"]))
    return f"**{entry['name']}**: {entry['figure']}.\n\n{items}"


def _readings(report: Mapping[str, Any], rows: Sequence[Mapping[str, Any]], with_split: bool = False) -> Table:
    """Return rows of readings, the split in a column if wanted."""
    cells = []
    for row in rows:
        each = zip(*(row["mm"][name] for name in NAMES), strict=True)
        split = [SPLIT_WORDS[row["split"]]] if with_split else []
        reading = f"{ERROR_WORDS[row['error']]}, {SPAN_WORDS[row['span']]}"
        cells.append([str(row["row"]), *split, reading, *(" ".join(map(_mm, both)) for both in each)])
    words = ["trained with", "reading"] if with_split else ["reading"]
    return Table("", ["row", *(Column(head, words=True) for head in words), *_horizons(report)], cells)


def _squares(report: Mapping[str, Any]) -> Table:
    """Return the least squares with and without velocities."""
    rows = [
        (f"positions{' and velocity' * row['velocity']}, {row['rate_hz']} Hz", *map(_mm, row["mm"]))
        for row in report["least_squares"]
    ]
    return Table("", ["past", *_horizons(report)], rows)


def _windows(report: Mapping[str, Any]) -> Table:
    """Return the errors of an axis over the steps of short windows."""
    rows = [(row["hand"], row["name"], *map(_mm, (*row["rmse_mm"], *row["mae_mm"]))) for row in report["windows"]]
    heads = [f"{error} {axis}" for error in ("RMSE", "MAE") for axis in "xyz"]
    return Table("", ["arm", Column("forecast", words=True), *heads], rows)


def _published(report: Mapping[str, Any], with_verdict: bool = False) -> Table:
    """Return the published figures with rows and range, for the page with standing and verdict."""
    rows = []
    for entry in report["published"]:
        ranges = [entry["ours_mm"].get(name) for name in NAMES]
        words = (NONE if each is None else f"{_mm(each[0])} to {_mm(each[1])}" for each in ranges)
        where = f"{standing(entry)} `{NAMES[1]}`" if standing(entry) else NONE
        more = [where, entry["verdict"]] if with_verdict else []
        rows.append([entry["name"], entry["figure"], _numbers(entry["rows"]), *words, *more])
    names = [f"`{name}`" for name in NAMES] if with_verdict else NAMES
    more = [Column(head, words=True) for head in ("the figure is", "verdict")] if with_verdict else []
    return Table("", ["published", Column("figure", words=True), "rows", *names, *more], rows)


def _horizons(report: Mapping[str, Any]) -> list[str]:
    return [f"{horizon:g} s" for horizon in report["horizons_s"]]


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
