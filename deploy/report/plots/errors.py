"""Errors over time, of positions, orientations and set points, and against the age of the newest sample."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from bokeh.models.ranges import DataRange1d, Range1d
from bokeh.plotting import figure

from tis.common.units import MM_PER_M, NS_PER_S
from tis.deploy.present import plot_style as style
from tis.deploy.present.numbers import number
from tis.deploy.present.palette import AMBER, CHANGED, SERIES, SLATE, STATES, Tone
from tis.deploy.report.run_view import HandView
from tis.deploy.report.subjects.safety import SetPoints
from tis.deploy.report.subjects.tracking import Array, ErrorByAge, error_by_age

_AGE_TIP: Final = ("age", "@age{0.0} ms")


@dataclass(frozen=True)
class Errors:
    """One hand's errors by name (T,), of positions or of orientations, the active one among them, and how they read.

    ``column`` names them in the hand's source; ``mark`` ends the names of their lines, as hold of the positions and
    hold of the orientations are hidden apart.
    """

    view: HandView
    by_name: Mapping[str, Array]
    active: str
    title: str
    column: str
    unit: str
    statistic: str
    digits: int
    mark: str = ""


def errors_of(view: HandView) -> tuple[Errors, Errors]:
    """Return the errors of the estimators and those of the orientation methods."""
    turning, deg = view.active_orientation, "\u00b0"
    return (
        Errors(view, view.errors_mm, view.active, "Error", "error", "mm", "RMSE in 3D", 3),
        Errors(view, view.turns_deg, turning, "Orientation error", "turn", deg, "RMS angle", 2, " turn"),
    )


def age_figure(errors: Errors) -> style.Figure | None:
    """Draw the errors over age at the scored ticks; None when there are too few."""
    view, unit = errors.view, errors.unit
    scored = view.track.scored
    curves = {n: error_by_age(view.age_ms[scored], e[scored]) for n, e in errors.by_name.items()}
    curves = {name: curve for name, curve in curves.items() if len(curve.n)}
    if not curves:
        return None
    every = style.line_styles(list(errors.by_name), errors.active)  # so that styles match the other figures
    lines = {name: (curve, every[name]) for name, curve in curves.items()}
    ends = (f"{n} from {number(c.rmse[0])} to {number(c.rmse[-1])} {unit}" for n, c in curves.items())
    return style.Figure(
        plots=(age_lines(lines, f"{errors.statistic}, {unit}", unit, errors.mark),),
        title=f"{errors.title} against age: {view.title}",
        caption=_age_caption(errors, curves),
        alt=f"Line chart of the error over the age of the newest sample. {', '.join(ends)}.",
        keys=style.line_keys({name: look for name, (_, look) in lines.items()}, errors.mark),
    )


def age_lines(
    lines: Mapping[str, tuple[ErrorByAge, style.LineStyle]], label: str, unit: str, mark: str = ""
) -> figure:
    """Return lines of errors by the age of the newest sample; ``mark`` ends the names of their renderers."""
    fig = style.plain_figure(300, x_axis_label="age of the newest sample at the tick, ms", y_axis_label=label)
    fig.y_range = DataRange1d(start=0, only_visible=True)
    for name, (curve, look) in lines.items():
        source = style.data(age=curve.age_ms, rmse=curve.rmse, n=curve.n.astype(np.int32))
        line = fig.line("age", "rmse", source=source, line_color=look.colour, line_width=look.width)
        line.glyph.line_dash = look.look.dash
        dots = fig.scatter("age", "rmse", source=source, size=7, fill_color=look.colour, line_color=None)
        style.named(f"{name}{mark}", [line, dots], look.shown)
        style.hover(fig, dots, (name, f"@rmse{{0.000}} {unit}"), _AGE_TIP, ("ticks", "@n"))
    return fig


def _age_caption(errors: Errors, curves: dict[str, ErrorByAge]) -> str:
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


def error_figure(errors: Errors, x_range: Range1d) -> style.Figure | None:
    """Draw the errors over time, of positions with the age below; None when no tick has both estimate and truth."""
    view, unit = errors.view, errors.unit
    if not any(np.isfinite(each).any() for each in errors.by_name.values()):
        return None
    styles = style.line_styles(list(errors.by_name), errors.active)
    of_positions, what = not errors.mark, errors.title.lower()
    has_age = of_positions and bool(np.isfinite(view.age_ms).any())
    fig = style.time_figure(x_range, f"{what}, {unit}", 240, with_axis=not has_age)
    fig.y_range = DataRange1d(only_visible=True, start=0)
    tip = f"{{0.{'0' * errors.digits}}} {unit}"
    style.lines_over_time(fig, view.source, styles, errors.column, tip, errors.mark, _AGE_TIP)
    scored = view.track.scored
    first_s = float(view.track.t_ns[np.argmax(scored)]) / NS_PER_S if of_positions and scored.any() else 0.0
    if first_s:
        style.shade(fig, None, first_s, CHANGED.light, fill_alpha=0.6)
    known = {name: each[scored] for name, each in errors.by_name.items() if np.isfinite(each[scored]).any()}
    largest = ", ".join(f"{n} {np.nanmax(each):.{errors.digits - 1}f} {unit}" for n, each in known.items())
    return style.Figure(
        plots=(style.stacked([fig, _age_panel(view, x_range)]) if has_age else fig,),
        title=f"{errors.title} over time: {view.title}",
        caption=_caption(view, has_age, first_s > 0) if of_positions else _turn_caption(view),
        alt=f"Line chart of the {what} over run time. Largest error: {largest}.",
        keys=style.line_keys(styles, errors.mark),
    )


def _age_panel(view: HandView, x_range: Range1d) -> figure:
    panel = style.time_figure(x_range, "age, ms", 150)
    panel.y_range = DataRange1d(start=0)
    line = panel.step("t", "age", source=view.source, mode="after", line_color=SLATE.light, line_width=1.2)
    style.hover(panel, line, ("run time", "@t{0.000} s"), _AGE_TIP)
    return panel


def _caption(view: HandView, has_age: bool, has_settling: bool) -> str:
    text = "The lower, the better: the distance between an estimate and the arm at each tick. "
    if view.active in view.errors_mm and view.active != "hold":
        text += "hold, which only repeats the newest arm position that arrived, is the error without estimating. "
    error_mm = view.scored(view.errors_mm, view.active)
    if np.isfinite(error_mm).any():
        place = int(np.nanargmax(error_mm))
        at_s, age_ms = view.track.t_ns[place] / NS_PER_S, view.age_ms[place]
        old = f", where the newest sample is {age_ms:.0f} ms old" if np.isfinite(age_ms) else ""
        text += f"{view.active} errs most at {at_s:.1f} s, by {number(error_mm[place])} mm{old}. "
    if has_age:
        text += "Below: the age of the newest sample; it rises where messages are late or lost. "
    if has_settling:
        text += "The grey part is not scored, as filters may still settle there. "
    text += "Drag sideways or over a rectangle to zoom in; all figures over time follow."
    return text.strip() + view.thinning_note()


def _turn_caption(view: HandView) -> str:
    text = "The angle between the estimated and the true orientation of the arm at each tick. "
    active = view.active_orientation
    scored_deg = view.scored(view.turns_deg, active)
    if np.isfinite(scored_deg).any():
        rms = number(float(np.sqrt(np.nanmean(scored_deg**2))))
        text += f"{active}, which the answers carry, errs by {rms}\u00b0 (RMS over the scored ticks). "
    return text.strip() + view.thinning_note()


_TONES: Final[dict[str, Tone]] = {
    "resuming": STATES[0], "hold": STATES[1], "slow stop": STATES[3], "safe": STATES[2],
}  # fmt: skip
"""Colours of the safety states but tracking, by their names in words."""
_MAX_SPANS: Final = 200


class _Span(NamedTuple):
    state: str
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
    source = style.data(t=t_s[kept], error=error_mm[kept])
    fig = style.time_figure(x_range, "error, mm", 220)
    fig.y_range = DataRange1d(start=0)
    for span in spans[:_MAX_SPANS]:
        style.shade(fig, span.begin_s, span.end_s, _TONES[span.state].light)
    keys = [style.Key("set point", AMBER, "line")]
    if view.active in view.errors_mm:
        fig.line("t", f"{view.active} error", source=view.source, line_color=SERIES[0].light, line_width=1.2)
        keys.append(style.Key(f"{view.active}, the estimate", SERIES[0], "line"))
    fig.line("t", "error", source=source, line_color=AMBER.light, line_width=2.0)
    keys += [style.Key(state, _TONES[state], "bar") for state in dict.fromkeys(span.state for span in spans)]
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
        state = str(mode[begin]).replace("_", " ")
        if state in _TONES:
            yield _Span(state, float(t_s[begin]), float(t_s[min(end, len(t_s) - 1)]))


def _safety_caption(view: HandView, driven: SetPoints, spans: list[_Span]) -> str:
    steps = [
        MM_PER_M * float(np.nanmax(np.linalg.norm(np.diff(where, axis=0), axis=1), initial=0.0))
        for where in (driven.position_m, view.track.estimates.get(view.active, driven.position_m))
    ]
    return (
        "The set point drives the arm. In tracking it is the active estimate, bit for bit, unless a limit of "
        "workspace, speed or acceleration is in the way. On old or uncertain data it holds, stops and "
        "is safe; after each break it resumes within a speed and an acceleration. "
        f"{_states(spans)} Largest step from tick to tick: set point {steps[0]:.1f} mm, estimate {steps[1]:.1f} mm. "
        f"They differ at {int(driven.differs.sum())} of {view.n_ticks} ticks."
    )


def _states(spans: list[_Span]) -> str:
    if not spans:
        return "The state was tracking throughout."
    times = {state: sum(one.end_s - one.begin_s for one in spans if one.state == state) for state in _TONES}
    parts = [f"{state} {seconds:.1f} s" for state, seconds in times.items() if seconds > 0]
    return f"Time outside tracking: {', '.join(parts)}."
