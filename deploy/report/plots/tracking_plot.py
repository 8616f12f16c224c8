"""Truth and estimates over time, one panel per axis."""

import numpy as np
from bokeh.layouts import gridplot
from bokeh.models.ranges import DataRange1d, Range1d
from bokeh.models.tools import HoverTool

from tis.common.units import MM_PER_M
from tis.deploy.report.plots import plot_style as style
from tis.deploy.report.plots.hand_view import HandView


def tracking_figure(view: HandView, x_range: Range1d) -> style.Figure | None:
    """Draw truth and estimates; None without ticks."""
    if not view.n_ticks:
        return None
    names = list(view.lines_m)
    styles = style.line_styles(names, view.active)
    panels = []
    for axis in "xyz":
        panel = style.time_figure(
            x_range, f"{axis}, mm", 190 if axis == "x" else 200 if axis == "z" else 160, axis == "z"
        )
        panel.y_range = DataRange1d(only_visible=True)
        lines = {}
        for name, look in styles.items():
            lines[name] = panel.line(
                "t",
                f"{name} {axis}",
                source=view.source,
                line_color=look.colour,
                line_width=look.width,
                line_dash=look.look.dash,
            )
            style.named(name, [lines[name]], look.shown)
        tips = [("run time", "@t{0.000} s"), *((name, f"@{{{name} {axis}}}{{0.00}} mm") for name in names)]
        panel.add_tools(HoverTool(renderers=[lines["truth"]], tooltips=tips, mode="vline"))
        panels.append(panel)
    return style.Figure(
        plots=(gridplot([[panel] for panel in panels], sizing_mode="stretch_width", toolbar_location="above"),),
        title=f"Position over time: {view.title}",
        caption=_caption(view),
        alt=f"Three line charts of the arm's x, y and z over run time: {', '.join(names)}. {range_text(view)}",
        keys=style.line_keys(styles),
    )


def range_text(view: HandView) -> str:
    """Return a sentence on the range of the arm's movement."""
    there = view.track.truth_m[np.isfinite(view.track.truth_m).all(axis=1)]
    if not len(there):
        return "The truth is not known."
    widths = " by ".join(f"{MM_PER_M * width_m:.0f}" for width_m in np.ptp(there, axis=0))
    return f"The arm moves over {widths} mm."


def _caption(view: HandView) -> str:
    text = "The thick line is the truth; an estimate is good where it covers that line. "
    if view.active in view.track.estimates and view.active != "hold":
        text += f"hold trails behind whenever the arm moves; {view.active} should not. "
    return text + range_text(view) + view.thinning_note()
