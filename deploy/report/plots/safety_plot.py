"""Set points in the report: the set point's error beside the estimate's, over the safety states."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from bokeh.models.annotations import BoxAnnotation
from bokeh.models.ranges import DataRange1d, Range1d
from bokeh.models.sources import ColumnDataSource

from tis.common.units import MM_PER_M, NS_PER_S
from tis.deploy.report.measures.safety import SetPoints
from tis.deploy.report.palette import AMBER, SERIES, STATES, Tone
from tis.deploy.report.plots import plot_style as style
from tis.deploy.report.plots.hand_view import HandView
from tis.deploy.report.plots.thinning import column

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
        caption=_caption(view, driven, spans),
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


def _caption(view: HandView, driven: SetPoints, spans: list[_Span]) -> str:
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
