"""Matplotlib figures of a comparison: ratio to hold by settings that are no scale, error against age."""

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from tis.deploy.compare.results.axes import numeric_axes
from tis.deploy.compare.results.people import band_words
from tis.deploy.compare.results.plot_style import draw_line, tone
from tis.deploy.report.publication.matplotlib_figures import STYLE


def ratio_figure(report: dict[str, Any]) -> Figure | None:
    """Return RMSE over hold's as heat maps of two axes, or with its intervals by setting where no axis is numeric.

    None without a sweep, and where `tis.deploy.compare.results.curves` draws the same to scale.
    """
    if len(report["axes"]) == 2 and not report["zipped"]:
        return _heat_maps(report)
    settings = [about["setting"] for about in report["settings"] if about["n_cells"]]
    if len(settings) < 2 or numeric_axes(report):
        return None
    names = list(dict.fromkeys(row["estimator"] for row in report["rows"]))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(5.5, 3.6), layout="constrained")
        axes = figure.subplots()
        for name in names:
            rows = {row["setting"]: row for row in report["rows"] if row["estimator"] == name}
            shown = [(x, rows[s]) for x, s in enumerate(settings) if s in rows]
            shown = [(x, row) for x, row in shown if row["ratio_to_hold"] is not None]
            draw_line(axes, name, names, [x for x, _ in shown], [row["ratio_to_hold"] for _, row in shown])
            for x, row in shown:
                interval = row["ratio_to_hold_interval_95"]
                if interval is not None:
                    axes.plot([x, x], interval, color=tone(name, names), linewidth=0.8, alpha=0.6)
        axes.set_xticks(range(len(settings)), settings, rotation=30 if len(settings) > 4 else 0)
        axes.set_xlabel(report["sweep"])
        axes.set_ylabel("3D RMSE over hold's")
        axes.set_ylim(0, min(2.0, 1.05 * max(axes.get_ylim()[1], 1.0)))
        bars = band_words(report).replace("ands", "ars")
        axes.set_title(f"Error beside holding the newest value\n{bars}", loc="left")
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
            axes.set_xlabel(across)
            axes.set_title(name, loc="left")
        each[0].set_ylabel(up)
        figure.colorbar(image, ax=list(each), label="3D RMSE over hold's")
    return figure


def age_figure(report: dict[str, Any]) -> Figure | None:
    """Return the 3D error against the age of the freshest sample, all settings together; None without any."""
    by_age: dict[str, dict[float, list[float]]] = {}
    for row in report["rows"]:
        for entry in row["rmse_by_age_mm"]:
            sums = by_age.setdefault(row["estimator"], {}).setdefault(entry["from_ms"], [0.0, 0.0])
            sums[0] += entry["n"]
            sums[1] += entry["n"] * entry["rmse_3d_mm"] ** 2
    if not by_age:
        return None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(5.5, 3.6), layout="constrained")
        axes = figure.subplots()
        for name, bins in by_age.items():
            ages = sorted(bins)
            draw_line(axes, name, list(by_age), ages, [(bins[age][1] / bins[age][0]) ** 0.5 for age in ages])
        axes.set_xlabel("age of the freshest sample, ms (lower edge of the bin)")
        axes.set_ylabel("3D RMSE, mm")
        top = max(row[1] / row[0] for row in by_age.get("hold", {}).values()) ** 0.5 if "hold" in by_age else None
        axes.set_ylim(0, None if not top else 1.6 * top)
        axes.set_title("Error against age", loc="left")
        axes.legend(ncols=2)
    return figure
