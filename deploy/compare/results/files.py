"""Files of a comparison: all forms of its report, and the names of those that may be left by an earlier one."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from tis.common.errors import GET_PARQUET, GET_REPORT
from tis.deploy.compare.engine.compute import Outcome
from tis.deploy.compare.plan import Plan
from tis.deploy.compare.results import tables
from tis.deploy.compare.results.latex import latex_table
from tis.deploy.compare.results.page.page_sums import PageSums, page_sums
from tis.deploy.compare.results.rows import report as build_report
from tis.deploy.compare.results.tidy import FILE, parquet, tidy_rows
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.extras import can_report
from tis.deploy.shell.outputs import check_outputs

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FIGURES: Final = ("curves", "ratio", "error_by_age")
_FORMATS: Final = ("svg", "pdf")
_PAGE: Final = "comparison.html"
_ALWAYS: Final = ("table.json", "table.csv", "trials.csv", "orientation.csv", "table.md", "ratio.tex")
_OPTIONAL: Final = (*(f"{name}.{form}" for name in _FIGURES for form in _FORMATS), FILE, _PAGE)
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
        "table.csv": tables.pooled_csv(report),
        "trials.csv": tables.trials_csv(report),
        "orientation.csv": tables.orientation_csv(report),
        "table.md": tables.markdown(report),
        "ratio.tex": latex_table(report),
    }
    left_out = []
    if find_spec("pyarrow") is None:
        left_out.append(f"no {FILE} without pyarrow: {GET_PARQUET}")
    else:
        files[FILE] = parquet(results.rows)
    if find_spec("matplotlib") is None:
        left_out.append(f"no figures without matplotlib: {GET_REPORT}")
    else:
        files |= _drawn(report)
    if can_report():
        from tis.deploy.compare.results.page.comparison_html import comparison_html  # loads Bokeh

        files[_PAGE] = comparison_html(report, results.sums)
    else:
        left_out.append(f"no {_PAGE} without Bokeh: {GET_REPORT}")
    return Files(files, left_out)


def check_files(path: Path) -> None:
    """Raise `DataError` with all files of a comparison that cannot be written below ``path``."""
    check_outputs(*(path / name for name in (*_ALWAYS, *_OPTIONAL)))


def write_files(files: Files, path: Path) -> None:
    """Write the files, and delete those of another comparison that was in the folder; raises `DataError`."""
    for name in _OPTIONAL:
        if name not in files.contents:
            folder.remove(path / name)
    for name, content in files.contents.items():
        folder.write(path / name, content)


def figures_of(report: dict[str, Any]) -> "dict[str, Figure]":
    """Return the figures that a report has, by name; needs matplotlib."""
    from tis.deploy.compare.results.curves import curves_figure  # loads matplotlib
    from tis.deploy.compare.results.plots import age_figure, ratio_figure

    drawn = zip(_FIGURES, (curves_figure(report), ratio_figure(report), age_figure(report)), strict=True)
    return {name: figure for name, figure in drawn if figure is not None}


def _drawn(report: dict[str, Any]) -> dict[str, bytes]:
    from tis.deploy.report.publication.matplotlib_figures import rendered

    figures = figures_of(report)
    return {f"{name}.{form}": rendered(figure, form) for name, figure in figures.items() for form in _FORMATS}
