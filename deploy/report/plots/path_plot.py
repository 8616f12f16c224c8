"""Path of the arm in three planes, as Bokeh has no third dimension."""

import numpy as np
from bokeh.models.ranges import Range1d
from bokeh.models.tools import HoverTool

from common.units import MM_PER_M
from deploy.report.plots import plot_style as style
from deploy.report.plots.hand_view import HandView
from deploy.report.plots.tracking_plot import range_text

_MARGIN = 0.06
_MIN_SPAN_MM = 1.0


def path_figure(view: HandView) -> style.Figure | None:
    """Draw truth and estimates in the planes xy, xz and yz, to one scale; None without truth."""
    truth_mm = MM_PER_M * view.track.truth_m
    if not np.isfinite(truth_mm).all(axis=1).any():
        return None
    low, high = np.nanmin(truth_mm, axis=0), np.nanmax(truth_mm, axis=0)
    half = max(float(np.max(high - low)), _MIN_SPAN_MM) * (0.5 + _MARGIN)
    middle = (low + high) / 2
    # shared ranges: zooming in one plane zooms the same box in the others
    ranges = [Range1d(start=float(m - half), end=float(m + half)) for m in middle]
    styles = style.line_styles(list(view.lines_m), view.active)
    plots = []
    for across, up in ((0, 1), (0, 2), (1, 2)):
        fig = style.plain_figure(
            330,
            x_axis_label=f"{'xyz'[across]}, mm",
            y_axis_label=f"{'xyz'[up]}, mm",
            x_range=ranges[across],
            y_range=ranges[up],
        )
        lines = {}
        for name, look in styles.items():
            lines[name] = fig.line(
                f"{name} {'xyz'[across]}",
                f"{name} {'xyz'[up]}",
                source=view.source,
                line_color=look.colour,
                line_width=0.8 * look.width,
                line_dash=look.look.dash,
            )
            style.named(name, [lines[name]], look.shown)
        fig.add_tools(HoverTool(renderers=[lines["truth"]], tooltips=[("run time", "@t{0.000} s")]))
        plots.append(fig)
    return style.Figure(
        plots=tuple(plots),
        title=f"Path in space: {view.title}",
        caption="The same path in the planes of x and y, x and z, y and z, to one scale. Estimates cut corners or "
        f"overshoot where they leave the truth. {range_text(view)} Zoom in one plane and the others follow.",
        alt=f"Three projections of the arm's path: x against y, x against z, y against z. {range_text(view)}",
        keys=style.line_keys(styles),
    )
