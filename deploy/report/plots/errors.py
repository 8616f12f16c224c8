"""Errors over time, of positions, orientations and set points, and against the age of the newest sample."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from bokeh.layouts import gridplot
from bokeh.models import ColumnDataSource
from bokeh.models.annotations import BoxAnnotation
from bokeh.models.ranges import DataRange1d, Range1d
from bokeh.models.tools import HoverTool
from bokeh.plotting import figure

from tis.common.units import MM_PER_M, NS_PER_S
from tis.deploy.present import plot_style as style
from tis.deploy.present.numbers import number
from tis.deploy.present.palette import AMBER, CHANGED, SERIES, SLATE, STATES, Tone
from tis.deploy.present.thinning import column
from tis.deploy.report.run_view import HandView
from tis.deploy.report.subjects.safety import SetPoints
from tis.deploy.report.subjects.tracking import Array, ErrorByAge, error_by_age


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
        caption=_age_caption(errors, curves),
        alt="Line chart of the error over the age of the newest sample. "
        + ", ".join(
            f"{n} from {number(float(c.rmse[0]))} to {number(float(c.rmse[-1]))} {errors.unit}"
            for n, c in curves.items()
        )
        + ".",
        keys=style.line_keys(styles, errors.mark),
    )


def _age_caption(errors: _Errors, curves: dict[str, ErrorByAge]) -> str:
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
        caption=_turn_caption(view),
        alt=f"Line chart of the orientation error over run time. Largest error: {', '.join(_largest_turns(view))}.",
        keys=style.line_keys(styles, MARK),
    )


def _turn_caption(view: HandView) -> str:
    text = "The angle between the estimated and the true orientation of the arm at each tick. "
    active = view.active_orientation
    scored_deg = np.where(view.track.scored, view.turns_deg.get(active, np.nan), np.nan)
    if np.isfinite(scored_deg).any():
        rms = number(float(np.sqrt(np.nanmean(scored_deg**2))))
        text += f"{active}, which the answers carry, errs by {rms}\u00b0 (RMS over the scored ticks). "
    return text.strip() + view.thinning_note()


def _largest_turns(view: HandView) -> list[str]:
    """Return each method's largest error at the scored ticks."""
    scored = {name: turn_deg[view.track.scored] for name, turn_deg in view.turns_deg.items()}
    return [f"{name} {np.nanmax(error):.1f} degrees" for name, error in scored.items() if np.isfinite(error).any()]


_TONES: Final[dict[str, Tone]] = {
    "resuming": STATES[0],
    "hold": STATES[1],
    "slow_stop": STATES[3],
    "safe": STATES[2],
}
_NAMES: Final = {"resuming": "resuming", "hold": "hold", "slow_stop": "slow stop", "safe": "safe"}
_MAX_SPANS: Final = 200


class _Span(NamedTuple):
    mode: str
    begin_s: float
    end_s: float


def safety_figure(view: HandView, driven: SetPoints | None, x_range: Range1d) -> style.Figure | None:
    """Draw the errors of set point and active estimate; None where the set point was the estimate throughout."""
    if driven is None:
        return None
    spans = [*_spans(view, driven)]
    if not spans and not driven.differs.any():
        return None
    error_mm = MM_PER_M * np.linalg.norm(driven.position_m - view.track.truth_m, axis=1)
    t_s, kept = view.track.t_ns / NS_PER_S, view.kept
    source = ColumnDataSource({"t": column(t_s[kept]), "set point": column(error_mm[kept])})
    fig = style.time_figure(x_range, "error, mm", 220)
    fig.y_range = DataRange1d(start=0)
    for span in spans[:_MAX_SPANS]:
        tone = _TONES[span.mode].light
        fig.add_layout(
            BoxAnnotation(left=span.begin_s, right=span.end_s, fill_color=tone, line_color=None, level="underlay")
        )
    keys = [style.Key("set point", AMBER, "line")]
    if view.active in view.errors_mm:
        fig.line("t", f"{view.active} error", source=view.source, line_color=SERIES[0].light, line_width=1.2)
        keys.append(style.Key(f"{view.active}, the estimate", SERIES[0], "line"))
    fig.line("t", "set point", source=source, line_color=AMBER.light, line_width=2.0)
    keys += [style.Key(_NAMES[mode], _TONES[mode], "bar") for mode in dict.fromkeys(span.mode for span in spans)]
    return style.Figure(
        plots=(fig,),
        title=f"Set point and safety state: {view.title}",
        caption=_safety_caption(view, driven, spans),
        alt=f"Line chart of the errors of set point and estimate over run time. {_states(spans)}",
        keys=tuple(keys),
    )


def _spans(view: HandView, driven: SetPoints) -> Iterator[_Span]:
    """Yield the stretches of other states than tracking, once there is a set point."""
    mode, t_s = driven.mode, view.track.t_ns / NS_PER_S
    if not len(mode):
        return
    ends = np.flatnonzero(mode[1:] != mode[:-1]) + 1
    for begin, end in pairwise([0, *ends.tolist(), len(mode)]):
        if str(mode[begin]) in _TONES:
            yield _Span(str(mode[begin]), float(t_s[begin]), float(t_s[min(end, len(t_s) - 1)]))


def _safety_caption(view: HandView, driven: SetPoints, spans: list[_Span]) -> str:
    steps = [
        MM_PER_M * float(np.nanmax(np.linalg.norm(np.diff(where, axis=0), axis=1), initial=0.0))
        for where in (driven.position_m, view.track.estimates.get(view.active, driven.position_m))
    ]
    return (
        "The set point drives the arm. In tracking it is the active estimate, bit for bit. On old or uncertain data "
        "it holds, stops and is safe; after each break it resumes within a speed and an acceleration. "
        f"{_states(spans)} Largest step from tick to tick: set point {steps[0]:.1f} mm, estimate {steps[1]:.1f} mm. "
        f"They differ at {int(driven.differs.sum())} of {view.n_ticks} ticks."
    )


def _states(spans: list[_Span]) -> str:
    if not spans:
        return "The state was tracking throughout."
    times = {mode: sum(one.end_s - one.begin_s for one in spans if one.mode == mode) for mode in _TONES}
    parts = [f"{_NAMES[mode]} {seconds:.1f} s" for mode, seconds in times.items() if seconds > 0]
    return f"Time outside tracking: {', '.join(parts)}."
