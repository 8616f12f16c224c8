"""Error over time, and below it the age of the newest sample."""

import numpy as np
from bokeh.layouts import gridplot
from bokeh.models.annotations import BoxAnnotation
from bokeh.models.ranges import DataRange1d, Range1d
from bokeh.models.tools import HoverTool
from bokeh.plotting import figure

from tis.common.units import NS_PER_S
from tis.deploy.report.palette import CHANGED, SLATE
from tis.deploy.report.plots import plot_style as style
from tis.deploy.report.plots.hand_view import HandView
from tis.deploy.report.tables.numbers import number


def error_figure(view: HandView, x_range: Range1d) -> style.Figure | None:
    """Draw each estimator's error in 3D and the age; None when no tick has both estimate and truth."""
    if not any(np.isfinite(error_mm).any() for error_mm in view.errors_mm.values()):
        return None
    styles = style.line_styles(list(view.errors_mm), view.active)
    has_age = bool(np.isfinite(view.age_ms).any())
    fig = style.time_figure(x_range, "error, mm", 240, with_axis=not has_age)
    fig.y_range = DataRange1d(only_visible=True, start=0)
    lines = []
    for name, look in styles.items():
        line = fig.line("t", f"{name} error", source=view.source, line_color=look.colour, line_width=look.width)
        line.glyph.line_dash = look.look.dash
        style.named(name, [line], look.shown)
        lines.append(line)
    tips = [("run time", "@t{0.000} s"), *((name, f"@{{{name} error}}{{0.000}} mm") for name in styles)]
    fig.add_tools(HoverTool(renderers=[*lines[:1]], tooltips=[*tips, ("age", "@age{0.0} ms")], mode="vline"))
    panels = [fig, _age_panel(view, x_range)] if has_age else [fig]
    first_s = float(view.track.t_ns[np.argmax(view.track.scored)]) / NS_PER_S if view.track.scored.any() else 0.0
    if first_s:
        fig.add_layout(BoxAnnotation(right=first_s, fill_color=CHANGED.light, fill_alpha=0.6, line_color=None))
    return style.Figure(
        plots=(gridplot([[panel] for panel in panels], sizing_mode="stretch_width", toolbar_location="above"),),
        title=f"Error over time: {view.title}",
        caption=_caption(view, has_age, first_s > 0),
        alt=f"Line chart of the 3D error over run time. Largest error: {', '.join(_largest(view))}.",
        keys=style.line_keys(styles),
    )


def _age_panel(view: HandView, x_range: Range1d) -> figure:
    panel = style.time_figure(x_range, "age, ms", 150)
    panel.y_range = DataRange1d(start=0)
    line = panel.step("t", "age", source=view.source, mode="after", line_color=SLATE.light, line_width=1.2)
    panel.add_tools(HoverTool(renderers=[line], tooltips=[("run time", "@t{0.000} s"), ("age", "@age{0.0} ms")]))
    return panel


def _caption(view: HandView, has_age: bool, has_settling: bool) -> str:
    text = "The lower, the better: the distance between an estimate and the arm at each tick. "
    if view.active in view.errors_mm and view.active != "hold":
        text += "hold, which only repeats the newest arm position that arrived, is the error without estimating. "
    error_mm = np.where(view.track.scored, view.errors_mm.get(view.active, np.nan), np.nan)
    if np.isfinite(error_mm).any():
        place = int(np.nanargmax(error_mm))
        text += (
            f"{view.active} errs most at {view.track.t_ns[place] / NS_PER_S:.1f} s, by {number(error_mm[place])} mm"
        )
        text += (
            f", where the newest sample is {view.age_ms[place]:.0f} ms old. "
            if np.isfinite(view.age_ms[place])
            else ". "
        )
    if has_age:
        text += "Below: the age of the newest sample; it rises where messages are late or lost. "
    if has_settling:
        text += "The grey part is not scored, as filters may still settle there. "
    text += "Drag sideways or over a rectangle to zoom in; all figures over time follow."
    return text.strip() + view.thinning_note()


def _largest(view: HandView) -> list[str]:
    """Return each estimator's largest error at the scored ticks."""
    scored = {name: error_mm[view.track.scored] for name, error_mm in view.errors_mm.items()}
    return [f"{name} {np.nanmax(error):.2f} mm" for name, error in scored.items() if np.isfinite(error).any()]
