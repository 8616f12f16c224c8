"""Matplotlib figures of a comparison: ratio to hold by settings that are no scale, error against age."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from tis.deploy.compare.grid import axis_words
from tis.deploy.compare.results.pooled import band_words
from tis.deploy.compare.results.report import labels, numeric_axes, star_note
from tis.deploy.present.palette import look_of
from tis.deploy.report.publication.matplotlib_figures import STYLE

# Matplotlib figure of a comparison: errors against each numeric axis, with bands over people.

Rows = Sequence[dict[str, Any]]

_SCORES: Final = (("ratio_to_hold", "3D RMSE over hold's", 2.0), ("rmse_3d_mm", "3D RMSE, mm", 1.6))
"""Score, label, and the highest value shown: of the ratio itself, of the RMSE over the largest of hold."""
_MAX_PANELS: Final = 5
_PANEL_IN: Final = 2.4
_BESIDE_HOLD: Final = "Error beside holding the newest value"


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
            _draw(part, path, panels, report["rows"], labels(report))
        handles, names = parts[0].axes[0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center", ncols=4)
        figure.suptitle(_title(report, _BESIDE_HOLD, band_words(report)), fontsize=8.5)
    return figure


def _title(report: dict[str, Any], *lines: str) -> str:
    """Return the lines of a figure's title, and below them what a star means if the report has one."""
    return "\n".join(filter(None, [*lines, star_note(report)]))


def _panels(report: dict[str, Any], path: str) -> dict[str, Rows]:
    """Return the rows of each combination of the other axes' values, by its title; zipped axes are one."""
    panels: dict[str, list[dict[str, Any]]] = {}
    for row in report["rows"]:
        others = {} if report["zipped"] else {name: value for name, value in row["at"].items() if name != path}
        title = ", ".join(f"{name.split('.')[-1]} = {value}" for name, value in others.items())
        panels.setdefault(title, []).append(row)
    return dict(panels)


def _draw(part: SubFigure, path: str, panels: dict[str, Rows], all_rows: Rows, named: Mapping[str, str]) -> None:
    """Draw a row of panels for each score."""
    titles = list(panels)
    if len(titles) > _MAX_PANELS:
        titles = [titles[i] for i in np.linspace(0, len(titles) - 1, _MAX_PANELS).round().astype(int)]
        part.suptitle(f"{_MAX_PANELS} of {len(panels)} settings of the other axes", fontsize=8)
    each = part.subplots(2, len(titles), squeeze=False, sharex=True, sharey="row")
    held = [row["rmse_3d_mm"] for row in all_rows if row["estimator"] == "hold" and row["rmse_3d_mm"] is not None]
    for line, (score, label, most) in zip(each, _SCORES, strict=True):
        for axes, title in zip(line, titles, strict=True):
            _panel(axes, panels[title], path, score, named)
            axes.set_title(title if score == "ratio_to_hold" else "", loc="left")
        unit = 1.0 if score == "ratio_to_hold" else max(held, default=1.0)
        line[0].set_ylabel(label)
        line[0].set_ylim(0, min(line[0].get_ylim()[1], most * unit))
    for axes in each[-1]:
        axes.set_xlabel(axis_words(path))


def _panel(axes: Axes, rows: Rows, path: str, score: str, named: Mapping[str, str]) -> None:
    """Draw the line of each estimator with its band; ``named`` has their names in the legend."""
    names = list(named)
    for name in names:
        own = [row for row in rows if row["estimator"] == name and row[score] is not None]
        own.sort(key=lambda row: float(row["at"][path]))
        places = [float(row["at"][path]) for row in own]
        draw_line(axes, name, names, places, [row[score] for row in own], named[name])
        bounds = [(x, row.get(f"{score}_interval_95")) for x, row in zip(places, own, strict=True)]
        bands = [(x, *interval) for x, interval in bounds if interval is not None]
        if bands:
            where, low, high = zip(*bands, strict=True)
            axes.fill_between(where, low, high, color=tone(name, names), alpha=0.15, linewidth=0)
    places = sorted({float(row["at"][path]) for row in rows})
    if places[0] > 0 and places[-1] > 20 * places[0]:
        axes.set_xscale("log")


# Common style of a comparison's matplotlib figures: an estimator has the look that it has in reports.

_MARKERS: Final = "os^vDPX<>"
_DASHES: Final = {"solid": "-", "dashed": "--", "dotted": ":", "dashdot": "-."}


def tone(name: str, names: Sequence[str]) -> str:
    """Return the colour of one estimator of several."""
    return look_of(name, names).tone.light


def draw_line(
    axes: Axes, name: str, names: Sequence[str], x: Sequence[float], y: Sequence[float], label: str = ""
) -> None:
    """Draw the line of one estimator of several; where it is not solid, its markers are hollow.

    ``label`` names it in the legend, without one its name.
    """
    look, marker = look_of(name, names), _MARKERS[list(names).index(name) % len(_MARKERS)]
    axes.plot(
        x,
        y,
        color=look.tone.light,
        linestyle=_DASHES[look.dash],
        linewidth=1.0,
        marker=marker,
        markersize=4.5,
        markerfacecolor=look.tone.light if look.dash == "solid" else "white",
        label=label or name,
    )


def ratio_figure(report: dict[str, Any]) -> Figure | None:
    """Return RMSE over hold's as heat maps of two axes, or with its intervals by setting where no axis is numeric.

    None without a sweep, and where `tis.deploy.compare.results.figures` draws the same to scale.
    """
    if len(report["axes"]) == 2 and not report["zipped"]:
        return _heat_maps(report)
    settings = [about["setting"] for about in report["settings"] if about["n_cells"]]
    if len(settings) < 2 or numeric_axes(report):
        return None
    named = labels(report)
    names = list(named)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(5.5, 3.6), layout="constrained")
        axes = figure.subplots()
        for name in names:
            rows = {row["setting"]: row for row in report["rows"] if row["estimator"] == name}
            shown = [(x, rows[s]) for x, s in enumerate(settings) if s in rows]
            shown = [(x, row) for x, row in shown if row["ratio_to_hold"] is not None]
            ratios = [row["ratio_to_hold"] for _, row in shown]
            draw_line(axes, name, names, [x for x, _ in shown], ratios, named[name])
            for x, row in shown:
                interval = row["ratio_to_hold_interval_95"]
                if interval is not None:
                    axes.plot([x, x], interval, color=tone(name, names), linewidth=0.8, alpha=0.6)
        axes.set_xticks(range(len(settings)), settings, rotation=30 if len(settings) > 4 else 0)
        axes.set_xlabel(", ".join(map(axis_words, report["axes"])))
        axes.set_ylabel("3D RMSE over hold's")
        axes.set_ylim(0, min(2.0, 1.05 * max(axes.get_ylim()[1], 1.0)))
        bars = band_words(report).replace("ands", "ars")
        axes.set_title(_title(report, _BESIDE_HOLD, bars), loc="left")
        axes.legend(ncols=2)
    return figure


def _heat_maps(report: dict[str, Any]) -> Figure:
    """Return a map of the ratio for each estimator but hold, the first axis upwards."""
    up, across = report["axes"]
    rows = [row for row in report["rows"] if row["estimator"] != "hold" and row["ratio_to_hold"] is not None]
    names = list(dict.fromkeys(row["estimator"] for row in rows)) or ["hold"]
    ys, xs = (list(dict.fromkeys(about["at"][axis] for about in report["settings"])) for axis in (up, across))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(0.6 + 3.4 * len(names), 3.4), layout="constrained")
        each = figure.subplots(1, len(names), squeeze=False, sharey=True)[0]
        for axes, name in zip(each, names, strict=True):
            ratio = np.full((len(ys), len(xs)), np.nan)
            for row in rows:
                if row["estimator"] == name:
                    ratio[ys.index(row["at"][up]), xs.index(row["at"][across])] = row["ratio_to_hold"]
            # One scale for all maps; 1 is as good as holding.
            image = axes.imshow(ratio, origin="lower", aspect="auto", vmin=0.0, vmax=1.2, cmap="viridis")
            axes.set_xticks(range(len(xs)), xs, rotation=45 if len(xs) > 6 else 0)
            axes.set_yticks(range(len(ys)), ys)
            axes.set_xlabel(axis_words(across))
            axes.set_title(labels(report).get(name, name), loc="left")
        each[0].set_ylabel(axis_words(up))
        figure.colorbar(image, ax=list(each), label="3D RMSE over hold's")
        if star_note(report):
            figure.suptitle(star_note(report), fontsize=8.5)
    return figure


def age_figure(report: dict[str, Any]) -> Figure | None:
    """Return the 3D error against the age of the freshest sample, all settings together; None without any."""
    by_age: dict[str, dict[float, list[float]]] = {}
    for row in report["rows"]:
        for entry in row["rmse_by_age_mm"]:
            sums = by_age.setdefault(row["estimator"], {}).setdefault(entry["from_ms"], [0.0, 0.0, 0.0])
            sums[0] += entry["n"]
            sums[1] += entry["n"] * entry["rmse_3d_mm"] ** 2
            sums[2] += entry["n"] * entry["age_mean_ms"]
    if not by_age:
        return None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(5.5, 3.6), layout="constrained")
        axes = figure.subplots()
        for name, bins in by_age.items():
            pooled = [bins[low] for low in sorted(bins)]
            errors = [(squares / n) ** 0.5 for n, squares, _ in pooled]
            places = [ages / n for n, _, ages in pooled]
            draw_line(axes, name, list(by_age), places, errors, labels(report)[name])
        axes.set_xlabel("age of the freshest sample, ms")
        axes.set_ylabel("3D RMSE, mm")
        top = max(row[1] / row[0] for row in by_age.get("hold", {}).values()) ** 0.5 if "hold" in by_age else None
        axes.set_ylim(0, None if not top else 1.6 * top)
        axes.set_title(_title(report, "Error against age"), loc="left")
        axes.legend(ncols=2)
    return figure
