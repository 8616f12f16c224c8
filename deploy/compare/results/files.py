"""Files of a comparison: all forms of its report, and the names of those that may be left by an earlier one."""

import json
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from deploy.compare.results import tables
from deploy.compare.results.latex import latex_table
from deploy.compare.results.tidy import FILE, parquet
from deploy.shell import run_dir as folder
from deploy.shell.extras import GET_PARQUET, GET_REPORT

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FIGURES: Final = ("curves", "ratio", "error_by_age")
_FORMATS: Final = ("svg", "pdf")
_OPTIONAL: Final = (*(f"{name}.{form}" for name in _FIGURES for form in _FORMATS), FILE)
"""Files that not every comparison has."""


class Files(NamedTuple):
    """Contents by name, and what could not be made, with the command that helps."""

    contents: Mapping[str, str | bytes]
    left_out: Sequence[str]


def files_of(report: dict[str, Any], rows: Sequence[Mapping[str, Any]]) -> Files:
    """Return all forms of a report and its tidy ``rows``."""
    files: dict[str, str | bytes] = {
        "table.json": json.dumps(report, indent=1, allow_nan=False) + "\n",
        "table.csv": tables.pooled_csv(report),
        "trials.csv": tables.trials_csv(report),
        "table.md": tables.markdown(report),
        "ratio.tex": latex_table(report),
    }
    left_out = []
    if find_spec("pyarrow") is None:
        left_out.append(f"no {FILE} without pyarrow: {GET_PARQUET}")
    else:
        files[FILE] = parquet(rows)
    if find_spec("matplotlib") is None:
        left_out.append(f"no figures without matplotlib: {GET_REPORT}")
    else:
        files |= _drawn(report)
    return Files(files, left_out)


def write_files(files: Files, path: Path) -> None:
    """Write the files, and delete those of another comparison that was in the folder; raises `DataError`."""
    for name in _OPTIONAL:
        if name not in files.contents:
            (path / name).unlink(missing_ok=True)
    for name, content in files.contents.items():
        folder.write(path / name, content)


def figures_of(report: dict[str, Any]) -> "dict[str, Figure]":
    """Return the figures that a report has, by name; needs matplotlib."""
    from deploy.compare.results.curves import curves_figure  # loads matplotlib
    from deploy.compare.results.plots import age_figure, ratio_figure

    drawn = zip(_FIGURES, (curves_figure(report), ratio_figure(report), age_figure(report)), strict=True)
    return {name: figure for name, figure in drawn if figure is not None}


def _drawn(report: dict[str, Any]) -> dict[str, bytes]:
    from deploy.report.publication.matplotlib_figures import rendered

    figures = figures_of(report)
    return {f"{name}.{form}": rendered(figure, form) for name, figure in figures.items() for form in _FORMATS}
