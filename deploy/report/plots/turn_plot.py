"""Orientation error over time."""

import numpy as np
from bokeh.models.ranges import DataRange1d, Range1d
from bokeh.models.tools import HoverTool

from tis.deploy.report.plots import plot_style as style
from tis.deploy.report.plots.hand_view import HandView
from tis.deploy.report.tables.numbers import number

MARK = " turn"
"""Ends the names of the lines: hold of the positions and hold of the orientations are hidden apart."""


def turn_figure(view: HandView, x_range: Range1d) -> style.Figure | None:
    """Draw the angle of each orientation method to the truth; None when no tick has both."""
    if not any(np.isfinite(turn_deg).any() for turn_deg in view.turns_deg.values()):
        return None
    styles = style.line_styles(list(view.turns_deg), view.active_orientation)
    fig = style.time_figure(x_range, "orientation error, \u00b0", 200)
    fig.y_range = DataRange1d(only_visible=True, start=0)
    lines = []
    for name, look in styles.items():
        line = fig.line("t", f"{name} turn", source=view.source, line_color=look.colour, line_width=look.width)
        line.glyph.line_dash = look.look.dash
        style.named(f"{name}{MARK}", [line], look.shown)
        lines.append(line)
    tips = [("run time", "@t{0.000} s"), *((name, f"@{{{name} turn}}{{0.00}} \u00b0") for name in styles)]
    fig.add_tools(HoverTool(renderers=[*lines[:1]], tooltips=[*tips, ("age", "@age{0.0} ms")], mode="vline"))
    return style.Figure(
        plots=(fig,),
        title=f"Orientation error over time: {view.title}",
        caption=_caption(view),
        alt=f"Line chart of the orientation error over run time. Largest error: {', '.join(_largest(view))}.",
        keys=style.line_keys(styles, MARK),
    )


def _caption(view: HandView) -> str:
    text = "The angle between the estimated and the true orientation of the arm at each tick. "
    active = view.active_orientation
    scored_deg = np.where(view.track.scored, view.turns_deg.get(active, np.nan), np.nan)
    if np.isfinite(scored_deg).any():
        rms = number(float(np.sqrt(np.nanmean(scored_deg**2))))
        text += f"{active}, which the answers carry, errs by {rms}\u00b0 (RMS over the scored ticks). "
    return text.strip() + view.thinning_note()


def _largest(view: HandView) -> list[str]:
    """Return each method's largest error at the scored ticks."""
    scored = {name: turn_deg[view.track.scored] for name, turn_deg in view.turns_deg.items()}
    return [f"{name} {np.nanmax(error):.1f} degrees" for name, error in scored.items() if np.isfinite(error).any()]
