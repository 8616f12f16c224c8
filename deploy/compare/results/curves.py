"""Matplotlib figure of a comparison: errors against each numeric axis, with bands over people."""

from collections.abc import Sequence
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from tis.deploy.compare.results.axes import numeric_axes
from tis.deploy.compare.results.people import band_words
from tis.deploy.compare.results.plot_style import draw_line, tone
from tis.deploy.report.publication.matplotlib_figures import STYLE

Rows = Sequence[dict[str, Any]]

_SCORES: Final = (("ratio_to_hold", "3D RMSE over hold's", 2.0), ("rmse_3d_mm", "3D RMSE, mm", 1.6))
"""Score, label, and the highest value shown: of the ratio itself, of the RMSE over the largest of hold."""
_MAX_PANELS: Final = 5
_PANEL_IN: Final = 2.4


def curves_figure(report: dict[str, Any]) -> Figure | None:
    """Return the errors of each estimator against each numeric axis; None without such an axis.

    The values of the other axes have a panel each; of many, five evenly spaced ones. Bands are the intervals of the
    rows.
    """
    paths = numeric_axes(report)[: 1 if report["zipped"] else None]
    if not paths:
        return None
    each = [_panels(report, path) for path in paths]
    n_columns = min(max(map(len, each)), _MAX_PANELS)
    with mpl.rc_context(STYLE):
        size = (max(5.5, 0.8 + _PANEL_IN * n_columns), 4.2 * len(paths) + 0.5)
        figure = Figure(figsize=size, layout="constrained")
        parts = figure.subfigures(len(paths), 1, squeeze=False)[:, 0]
        for part, path, panels in zip(parts, paths, each, strict=True):
            _draw(part, path, panels, report["rows"])
        handles, names = parts[0].axes[0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center", ncols=4)
        figure.suptitle(f"Error beside holding the newest value\n{band_words(report)}", fontsize=8.5)
    return figure


def _panels(report: dict[str, Any], path: str) -> dict[str, Rows]:
    """Return the rows of each combination of the other axes' values, by its title; zipped axes are one."""
    panels: dict[str, list[dict[str, Any]]] = {}
    for row in report["rows"]:
        others = {} if report["zipped"] else {name: value for name, value in row["at"].items() if name != path}
        title = ", ".join(f"{name.split('.')[-1]} = {value}" for name, value in others.items())
        panels.setdefault(title, []).append(row)
    return dict(panels)


def _draw(part: SubFigure, path: str, panels: dict[str, Rows], all_rows: Rows) -> None:
    """Draw a row of panels for each score."""
    titles = list(panels)
    if len(titles) > _MAX_PANELS:
        titles = [titles[i] for i in np.linspace(0, len(titles) - 1, _MAX_PANELS).round().astype(int)]
        part.suptitle(f"{_MAX_PANELS} of {len(panels)} settings of the other axes", fontsize=8)
    each = part.subplots(2, len(titles), squeeze=False, sharex=True, sharey="row")
    names = list(dict.fromkeys(row["estimator"] for row in all_rows))
    held = [row["rmse_3d_mm"] for row in all_rows if row["estimator"] == "hold" and row["rmse_3d_mm"] is not None]
    for line, (score, label, most) in zip(each, _SCORES, strict=True):
        for axes, title in zip(line, titles, strict=True):
            _panel(axes, panels[title], path, score, names)
            axes.set_title(title if score == "ratio_to_hold" else "", loc="left")
        unit = 1.0 if score == "ratio_to_hold" else max(held, default=1.0)
        line[0].set_ylabel(label)
        line[0].set_ylim(0, min(line[0].get_ylim()[1], most * unit))
    for axes in each[-1]:
        axes.set_xlabel(path if len(titles) < 2 else path.split(".")[-1])


def _panel(axes: Axes, rows: Rows, path: str, score: str, names: Sequence[str]) -> None:
    """Draw the line of each estimator with its band."""
    for name in names:
        own = [row for row in rows if row["estimator"] == name and row[score] is not None]
        own.sort(key=lambda row: float(row["at"][path]))
        places = [float(row["at"][path]) for row in own]
        draw_line(axes, name, names, places, [row[score] for row in own])
        bounds = [(x, row.get(f"{score}_interval_95")) for x, row in zip(places, own, strict=True)]
        bands = [(x, *interval) for x, interval in bounds if interval is not None]
        if bands:
            where, low, high = zip(*bands, strict=True)
            axes.fill_between(where, low, high, color=tone(name, names), alpha=0.15, linewidth=0)
    places = sorted({float(row["at"][path]) for row in rows})
    if places[0] > 0 and places[-1] > 20 * places[0]:
        axes.set_xscale("log")
