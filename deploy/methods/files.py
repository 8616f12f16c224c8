"""Files of the comparison: figures of every method as JSON and CSV, the paper's table for LaTeX, and plots."""

import csv
import io
import json
from collections.abc import Iterator, Mapping
from importlib.util import find_spec
from typing import Any, Final, NamedTuple

from tis.common.errors import GET_REPORT
from tis.deploy.compare.results.latex import tabular
from tis.deploy.methods.main_table import main_table

_FORMATS: Final = ("svg", "pdf")
PLOTS: Final = ("accuracy", "disturbances", "training", "steps")
NAMES: Final = ("methods.json", "methods.csv", "methods.tex", *(f"{n}.{form}" for n in PLOTS for form in _FORMATS))
_HEAD: Final = ("method", "measure", "at", "figure", "value")
_PLACES: Final = ("delay_ms", "loss_pct", "bursts", "noise_mm", "n_trials", "trained_on", "block_rows")
"""Figures that say at which setting the others of an entry were measured."""


class Files(NamedTuple):
    """Contents by name, and what could not be made, with the command that helps."""

    contents: Mapping[str, str | bytes]
    left_out: tuple[str, ...]


def files_of(report: Mapping[str, Any]) -> Files:
    """Return all forms of a report (see `tis.deploy.methods.command.report_of`)."""
    files: dict[str, str | bytes] = {
        "methods.json": json.dumps(report, indent=1, allow_nan=False) + "\n",
        "methods.csv": csv_of(report),
        "methods.tex": tabular(*main_table(report["methods"]), f"% {report['command']}", n_text=4),
    }
    if find_spec("matplotlib") is None:
        return Files(files, (f"no figures without matplotlib: {GET_REPORT}",))
    from tis.deploy.methods.plots import FIGURES  # loads matplotlib
    from tis.deploy.report.publication.matplotlib_figures import rendered

    for name, draw in FIGURES.items():
        figure = draw(report["methods"])
        files |= {f"{name}.{form}": rendered(figure, form) for form in _FORMATS}
    return Files(files, ())


def csv_of(report: Mapping[str, Any]) -> str:
    """Return all figures in long form: one row a number, with the setting that it was measured at."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_HEAD)
    for figures in report["methods"]:
        for measure, content in figures.items():
            entries = content if isinstance(content, list) else [content]
            for entry in entries:
                if isinstance(entry, Mapping):
                    at = " ".join(f"{name}={entry[name]}" for name in _PLACES if name in entry)
                    writer.writerows((figures["method"], measure, at, *each) for each in _numbers(entry))
                elif isinstance(entry, float):
                    writer.writerow((figures["method"], measure, "", measure, entry))
    return text.getvalue()


def _numbers(entry: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, float]]:
    """Yield the numbers of an entry by name, those of its parts after theirs."""
    for name, value in entry.items():
        if prefix == "" and name in _PLACES:
            continue
        if isinstance(value, Mapping):
            yield from _numbers(value, f"{prefix}{name}.")
        elif isinstance(value, list):
            yield from ((f"{prefix}{name}.{i}", each) for i, each in enumerate(value) if each is not None)
        elif isinstance(value, int | float):
            yield f"{prefix}{name}", value
