"""Truth and estimates over time, one panel for each axis."""

from typing import Any

import numpy as np
from bokeh.layouts import gridplot
from bokeh.models import ColumnDataSource
from bokeh.models.ranges import Range1d
from bokeh.models.renderers import GlyphRenderer
from bokeh.models.tools import HoverTool

from common.units import MM_PER_M, NS_PER_S
from deploy.report import plot_style as style
from deploy.report.thinning import evenly
from deploy.report.tracking import HandTrack


def tracking_figure(track: HandTrack, active: str, which: str, x_range: Range1d) -> style.Figure | None:
    """Draw where the arm was and where the estimators put it; ``which`` names arm and source. None without ticks."""
    if not len(track.t_ns):
        return None
    kept = evenly(len(track.t_ns))
    lines = {"truth": track.truth_m, **track.estimates}
    data = {"t": style.column(track.t_ns[kept] / NS_PER_S)}
    for name, position_m in lines.items():
        for i, axis in enumerate("xyz"):
            data[f"{name} {axis}"] = style.column(MM_PER_M * position_m[kept, i])
    source = ColumnDataSource(data)
    styles = style.line_styles(list(track.estimates), active)
    drawn: dict[str, list[GlyphRenderer[Any]]] = {name: [] for name in lines}
    panels = []
    for axis in "xyz":
        panel = style.time_figure(x_range, f"{axis}, mm", 200 if axis == "x" else 170, with_axis=axis == "z")
        for name in lines:
            look = styles.get(name, style.LineStyle(style.TRUTH, 2.5, "solid", True))
            line = panel.line(
                "t",
                f"{name} {axis}",
                source=source,
                line_color=look.colour,
                line_width=look.width,
                muted_line_alpha=0.0,
            )
            line.muted = not look.shown
            drawn[name].append(line)
        tips = [("run time", "@t{0.000} s"), *((name, f"@{{{name} {axis}}}{{0.00}} mm") for name in lines)]
        panel.add_tools(HoverTool(renderers=[drawn["truth"][-1]], tooltips=tips, mode="vline"))
        panels.append(panel)
    style.add_legend(panels[0], drawn)
    return style.Figure(
        plot=gridplot([[panel] for panel in panels], sizing_mode="stretch_width", toolbar_location="above"),
        title=f"Position over time: {which}",
        says=_says(track, active, len(kept)),
        alt=f"Three line charts of the arm's x, y and z over run time: {', '.join(lines)}. {_spread(track)}",
    )


def _says(track: HandTrack, active: str, n_drawn: int) -> str:
    text = "Black is where the arm really was; an estimate is good where it covers the black line. "
    if active in track.estimates and active != "hold":
        text += f"hold (orange) trails behind whenever the arm moves; {active} (blue) should not. "
    text += "Drag sideways, or over a rectangle, to zoom in on a movement; the other figures over time follow. "
    text += "Click a name to show or hide it."
    if n_drawn < len(track.t_ns):
        text += f" Of {len(track.t_ns)} ticks, {n_drawn} are drawn, evenly spaced."
    return text


def _spread(track: HandTrack) -> str:
    there = track.truth_m[np.isfinite(track.truth_m).all(axis=1)]
    if not len(there):
        return "Where the arm really was is not known."
    return f"The arm moves over {' by '.join(f'{MM_PER_M * width_m:.0f}' for width_m in np.ptp(there, axis=0))} mm."
