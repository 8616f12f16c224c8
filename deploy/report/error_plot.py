"""The distance between estimate and truth over time."""

from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource
from bokeh.models.annotations import BoxAnnotation
from bokeh.models.ranges import Range1d
from bokeh.models.renderers import GlyphRenderer
from bokeh.models.tools import HoverTool

from common.units import MM_PER_M, NS_PER_S
from deploy.report import plot_style as style
from deploy.report.thinning import worst
from deploy.report.tracking import HandTrack


def error_figure(track: HandTrack, active: str, which: str, x_range: Range1d) -> style.Figure | None:
    """Draw each estimator's error in 3D; None when no tick has both an estimate and the truth."""
    errors_mm = {
        name: MM_PER_M * np.linalg.norm(position_m - track.truth_m, axis=1)
        for name, position_m in track.estimates.items()
    }
    if not any(np.isfinite(error_mm).any() for error_mm in errors_mm.values()):
        return None
    largest_mm = np.fmax.reduce(list(errors_mm.values()))
    kept = worst(largest_mm)
    t_s = track.t_ns / NS_PER_S
    source = ColumnDataSource(
        {"t": style.column(t_s[kept]), **{name: style.column(error[kept]) for name, error in errors_mm.items()}}
    )
    fig = style.time_figure(x_range, "error, mm", 240)
    fig.y_range.start = 0  # type: ignore[attr-defined]
    drawn: dict[str, list[GlyphRenderer[Any]]] = {}
    for name, look in style.line_styles(list(errors_mm), active).items():
        line = fig.line("t", name, source=source, line_color=look.colour, line_width=look.width, muted_line_alpha=0.0)
        line.muted = not look.shown
        drawn[name] = [line]
    first = [lines[0] for lines in drawn.values()][:1]
    tips = [("run time", "@t{0.000} s"), *((name, f"@{{{name}}}{{0.000}} mm") for name in errors_mm)]
    fig.add_tools(HoverTool(renderers=[*first], tooltips=tips, mode="vline"))
    if track.scored.any():
        first_s = float(t_s[np.argmax(track.scored)])
        fig.add_layout(BoxAnnotation(left=0, right=first_s, fill_color="#8a949e", fill_alpha=0.15, line_color=None))
    style.add_legend(fig, drawn)
    says = "The lower, the better: the distance between an estimate and the arm at each tick. "
    if track.scored.any():
        says += "The grey part is not scored, since filters may still settle there. "
    says += "Peaks stand where the arm moves fast or where messages were lost; zoom in and compare with the delays."
    if len(kept) < len(t_s):
        says += f" Of each {-(-len(t_s) // len(kept))} neighbouring ticks the worst is drawn."
    return style.Figure(
        plot=fig,
        title=f"Error over time: {which}",
        says=says,
        alt="Line chart of the 3D error over run time. Largest error: "
        + ", ".join(f"{name} {np.nanmax(e):.2f} mm" for name, e in errors_mm.items() if np.isfinite(e).any())
        + ".",
    )
