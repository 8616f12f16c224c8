"""Files of a comparison: all forms of its report, and the names of those that may be left by an earlier one."""

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from tis.common.extras import GET_PARQUET, GET_REPORT
from tis.common.units import NS_PER_MS, NS_PER_US
from tis.deploy.compare.cells.sums import percentile
from tis.deploy.compare.engine.compute import Outcome
from tis.deploy.compare.plan import Plan
from tis.deploy.compare.results import tables
from tis.deploy.compare.results.page_sums import PageSums, page_sums
from tis.deploy.compare.results.pooled import person, pooled
from tis.deploy.compare.results.report import numbers_of
from tis.deploy.compare.results.report import report as build_report
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.guard import can_report, check_outputs_in

# The tidy table of a comparison: a row for each cell, hand and estimator, and a column for each swept field.
#
# It is what programs read: pandas, polars or R group its rows as they like.

FILE: Final = "cells.parquet"


def tidy_rows(plan: Plan, outcome: Outcome) -> list[dict[str, Any]]:
    """Return the rows in the order of the plan; what is unknown is None."""
    # A field is a number where all of its values are.
    are_numbers = {path: numbers_of(point.values[path] for point in plan.points) is not None for path in plan.axes}
    at_of = {
        point.label: {path: float(value) if are_numbers[path] else value for path, value in point.values.items()}
        for point in plan.points
    }
    rows = []
    for cell in plan.cells:
        result = outcome.cells.get(cell.digest)
        if result is None:
            continue
        about = {**at_of[cell.setting], "trial": cell.trial, "person": person(cell), "seed": result["seed"]}
        about["synthetic"] = cell.trial in plan.synthetic
        for hand, entry in result["hands"].items():
            n = entry["n_scored"]
            age_ms = entry["age_sum_ns"] / NS_PER_MS / n if n else None
            of_hand = {**about, "hand": hand, "age_mean_ms": age_ms}
            rows += [{**of_hand, "estimator": name, **_scores(entry, name)} for name in entry["estimators"]]
    return rows


def arrow(rows: Sequence[Mapping[str, Any]]) -> Any:
    """Return the rows as a `pyarrow.Table`; needs pyarrow."""
    import pyarrow as pa

    return pa.table({name: [row[name] for row in rows] for name in rows[0]} if rows else {})


def parquet(rows: Sequence[Mapping[str, Any]]) -> bytes:
    """Return the rows as a Parquet file; needs pyarrow."""
    import pyarrow.parquet as pq

    buffer = io.BytesIO()
    pq.write_table(arrow(rows), buffer, compression="zstd")
    return buffer.getvalue()


def _scores(entry: dict[str, Any], name: str) -> dict[str, Any]:
    """Return the scores of one estimator in one cell, those of each axis as columns of their own."""
    found, median_ns = pooled([[entry]], name), percentile(entry["estimators"][name].get("step_ns", {}), 50)
    of_axes = {
        f"{score}_{axis}": value
        for score in ("r2_pct", "rmse_mm")
        for axis, value in zip("xyz", found[score], strict=True)
    }
    return {
        "n_scored": found["n_scored"],
        "n_missing": found["n_missing"],
        **of_axes,
        **{score: found[score] for score in ("rmse_3d_mm", "ratio_to_hold", "coverage_pct")},
        "step_us": None if median_ns is None else median_ns / NS_PER_US,
    }


if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FIGURES: Final = ("curves", "ratio", "error_by_age")
_FORMATS: Final = ("svg", "pdf")
_PAGE: Final = "comparison.html"
_ALWAYS: Final = ("table.json", "table.csv", "trials.csv", "orientation.csv", "table.md", "ratio.tex")
_FELT_AND_SEEN: Final = "touch_and_sight.csv"
_OPTIONAL: Final = (_FELT_AND_SEEN, *(f"{name}.{form}" for name in _FIGURES for form in _FORMATS), FILE, _PAGE)
"""Files that not every comparison has."""


class Files(NamedTuple):
    """Contents by name, and what could not be made, with the command that helps."""

    contents: Mapping[str, str | bytes]
    left_out: Sequence[str]


@dataclass(frozen=True)
class Results:
    """A comparison's report, its tidy rows, and the sums that its page pools."""

    report: dict[str, Any]
    rows: Sequence[Mapping[str, Any]]
    sums: PageSums


def results_of(plan: Plan, outcome: Outcome, command: str) -> Results:
    """Return the results of what is computed; ``command`` makes them again."""
    return Results(build_report(plan, outcome, command), tidy_rows(plan, outcome), page_sums(plan, outcome))


def files_of(results: Results) -> Files:
    """Return all forms of the results."""
    report = results.report
    files: dict[str, str | bytes] = {
        "table.json": json.dumps(report, indent=1, allow_nan=False) + "\n",
        "table.csv": tables.csv(report["rows"]),
        "trials.csv": tables.csv(report["by_trial"]),
        "orientation.csv": tables.csv(report["orientation"]),
        "table.md": tables.markdown(report),
        "ratio.tex": tables.latex(report),
    }
    if report["touch_and_sight"]:
        files[_FELT_AND_SEEN] = tables.csv(report["touch_and_sight"])
    left_out = []
    if find_spec("pyarrow") is None:
        left_out.append(f"no {FILE} without pyarrow: {GET_PARQUET}")
    else:
        files[FILE] = parquet(results.rows)
    if find_spec("matplotlib") is None:
        left_out.append(f"no figures without matplotlib: {GET_REPORT}")
    else:
        from tis.deploy.report.publication.matplotlib_figures import rendered

        files |= {
            f"{name}.{form}": rendered(one, form) for name, one in figures_of(report).items() for form in _FORMATS
        }
    if can_report():
        from tis.deploy.compare.results.page_html import comparison_html  # loads Bokeh

        files[_PAGE] = comparison_html(report, results.sums)
    else:
        left_out.append(f"no {_PAGE} without Bokeh: {GET_REPORT}")
    return Files(files, left_out)


def check_files(path: Path) -> None:
    """Raise `DataError` with all files of a comparison that cannot be written below ``path``."""
    check_outputs_in(path, *_ALWAYS, *_OPTIONAL)


def write_files(files: Files, path: Path) -> None:
    """Write the files, and delete those of another comparison that was in the folder; raises `DataError`."""
    for name in _OPTIONAL:
        if name not in files.contents:
            folder.remove(path / name)
    for name, content in files.contents.items():
        folder.write(path / name, content)


def figures_of(report: dict[str, Any]) -> "dict[str, Figure]":
    """Return the figures that a report has, by name; needs matplotlib."""
    from tis.deploy.compare.results.figures import (
        age_figure,
        curves_figure,  # loads matplotlib
        ratio_figure,
    )

    drawn = zip(_FIGURES, (curves_figure(report), ratio_figure(report), age_figure(report)), strict=True)
    return {name: figure for name, figure in drawn if figure is not None}
