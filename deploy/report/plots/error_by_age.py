"""Error of each estimator against the age of the newest sample."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from bokeh.models import ColumnDataSource
from bokeh.models.ranges import DataRange1d
from bokeh.models.tools import HoverTool

from tis.deploy.present import plot_style as style
from tis.deploy.present.numbers import number
from tis.deploy.present.thinning import column
from tis.deploy.report.run_view import HandView
from tis.deploy.report.subjects.error_by_age import ErrorByAge, error_by_age
from tis.deploy.report.subjects.tracking import Array


@dataclass(frozen=True)
class _Errors:
    """Errors by name (T,), the active one among them, their unit and how it reads; ``mark`` tells toggles apart."""

    by_name: Mapping[str, Array]
    active: str
    unit: str
    label: str
    title: str
    mark: str = ""


def error_age_figure(view: HandView) -> style.Figure | None:
    """Draw each estimator's error over age at the scored ticks; None when there are too few."""
    title = f"Error against age: {view.title}"
    return _figure(view, _Errors(view.errors_mm, view.active, "mm", "RMSE in 3D, mm", title))


def turn_age_figure(view: HandView) -> style.Figure | None:
    """Draw the error of each orientation method over age, as `error_age_figure`."""
    title = f"Orientation error against age: {view.title}"
    errors = _Errors(view.turns_deg, view.active_orientation, "\u00b0", "RMS angle, \u00b0", title, " turn")
    return _figure(view, errors)


def _figure(view: HandView, errors: _Errors) -> style.Figure | None:
    scored = view.track.scored
    curves = {n: error_by_age(view.age_ms[scored], e[scored]) for n, e in errors.by_name.items()}
    curves = {name: curve for name, curve in curves.items() if len(curve.n)}
    if not curves:
        return None
    every = style.line_styles(list(errors.by_name), errors.active)  # so that styles match the other figures
    styles = {name: every[name] for name in curves}
    fig = style.plain_figure(300, x_axis_label="age of the newest sample at the tick, ms", y_axis_label=errors.label)
    fig.y_range = DataRange1d(start=0, only_visible=True)
    for name, curve in curves.items():
        look = styles[name]
        source = ColumnDataSource(
            {"age": column(curve.age_ms), "rmse": column(curve.rmse), "n": curve.n.astype(np.int32)}
        )
        line = fig.line("age", "rmse", source=source, line_color=look.colour, line_width=look.width)
        line.glyph.line_dash = look.look.dash
        dots = fig.scatter("age", "rmse", source=source, size=7, fill_color=look.colour, line_color=None)
        style.named(f"{name}{errors.mark}", [line, dots], look.shown)
        tips = [(name, f"@rmse{{0.000}} {errors.unit}"), ("age", "@age{0.0} ms"), ("ticks", "@n")]
        fig.add_tools(HoverTool(renderers=[dots], tooltips=tips))
    return style.Figure(
        plots=(fig,),
        title=errors.title,
        caption=_caption(errors, curves),
        alt="Line chart of the error over the age of the newest sample. "
        + ", ".join(
            f"{n} from {number(float(c.rmse[0]))} to {number(float(c.rmse[-1]))} {errors.unit}"
            for n, c in curves.items()
        )
        + ".",
        keys=style.line_keys(styles, errors.mark),
    )


def _caption(errors: _Errors, curves: dict[str, ErrorByAge]) -> str:
    text = "A good estimator stays low however old its newest sample is; hold rises as fast as the arm moves. "
    active, unit = errors.active, errors.unit
    curve = curves.get(active)
    if curve is None:
        return text.strip()
    low, high = curve.age_ms[0], curve.age_ms[-1]
    if len(curve.n) == 1:
        return text + f"Here nearly all samples have one age, {low:.0f} ms, so there is one point a line."
    text += f"Here {active} errs by {number(curve.rmse[0])} {unit} at {low:.0f} ms and by "
    text += f"{number(curve.rmse[-1])} {unit} at {high:.0f} ms"
    hold = curves.get("hold")
    if hold is not None and active != "hold":
        text += f", hold by {number(hold.rmse[0])} and {number(hold.rmse[-1])} {unit}"
    return text + ". Rare ages are merged, at least ten ticks a point."
