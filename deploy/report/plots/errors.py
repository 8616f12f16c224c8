"""Errors over time: of positions with the age of the newest sample, of orientations, and of set points."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from bokeh.layouts import gridplot
from bokeh.models.annotations import BoxAnnotation
from bokeh.models.ranges import DataRange1d, Range1d
from bokeh.models.sources import ColumnDataSource
from bokeh.models.tools import HoverTool
from bokeh.plotting import figure

from tis.common.units import MM_PER_M, NS_PER_S
from tis.deploy.present import plot_style as style
from tis.deploy.present.numbers import number
from tis.deploy.present.palette import AMBER, CHANGED, SERIES, SLATE, STATES, Tone
from tis.deploy.present.thinning import column
from tis.deploy.report.run_view import HandView
from tis.deploy.report.subjects.safety import SetPoints


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
