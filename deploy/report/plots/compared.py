"""Figures of several runs: distributions of latency, delay and error; error over time and against age."""

from collections.abc import Mapping, Sequence

import numpy as np
from bokeh.models.ranges import DataRange1d

from tis.common.units import NS_PER_MS, NS_PER_S
from tis.deploy.present import plot_style as style
from tis.deploy.present.numbers import number
from tis.deploy.present.palette import SERIES, Look
from tis.deploy.present.thinning import Array, worst
from tis.deploy.report.plots.distributions import Curve, distribution_figure
from tis.deploy.report.plots.errors import age_lines
from tis.deploy.report.plots.page_plots import mark_disturbances
from tis.deploy.report.run_view import MAX_TICKS, HandView, RunView
from tis.deploy.report.subjects.network.disturbances import Disturbance
from tis.deploy.report.subjects.network.key_figures import link_columns
from tis.deploy.report.subjects.tracking import error_by_age


def distributions(runs: Mapping[str, RunView], views: Mapping[str, HandView | None]) -> list[style.Figure | None]:
    """Return the distributions of latency, delay and error; ``views`` holds each run's compared hand or None."""

    def curves(values: Mapping[str, Array]) -> dict[str, Curve]:
        return {name: Curve(found, SERIES[i]) for i, (name, found) in enumerate(values.items()) if len(found)}

    return [
        distribution_figure(
            curves({name: np.asarray(run.measured.latency.end_to_end / NS_PER_MS) for name, run in runs.items()}),
            "How the latency is distributed",
            "end-to-end latency, ms",
            "How old the newest sample is, command or arm position, when the estimate made with it is published. "
            "Further left is better.",
        ),
        distribution_figure(
            curves({name: link_columns(run.logs, "forward").realised_ms for name, run in runs.items()}),
            "How the delays forward are distributed",
            "delay in netem, surgeon to patient, ms",
            "The delay of the messages that arrived; lost ones are not included.",
        ),
        distribution_figure(
            curves({name: _scored_errors(view) for name, view in views.items()}),
            "How the error is distributed",
            "error in 3D at the tick, mm",
            "Each run's active estimator at its scored ticks. Further left is better.",
            unit="mm",
        ),
    ]


def against_age(views: Mapping[str, HandView | None]) -> style.Figure | None:
    """Draw the error of each run's active estimator against age; None when no run has enough ticks."""
    lines = {}
    for i, (name, view) in enumerate(views.items()):
        if view is not None and view.active in view.errors_mm:
            scored = view.track.scored
            curve = error_by_age(view.age_ms[scored], view.errors_mm[view.active][scored])
            if len(curve.n):
                lines[name] = curve, style.LineStyle(Look(SERIES[i]), 2, True)
    if not lines:
        return None
    ends = ", ".join(f"{n} {number(c.rmse[0])} to {number(c.rmse[-1])} mm" for n, (c, _) in lines.items())
    return style.Figure(
        plots=(age_lines(lines, "RMSE in 3D, mm", "mm"),),
        title="Error against age",
        caption=f"Error of each run's active estimator from its youngest to its oldest samples: {ends}. Lines that "
        "coincide mean that the estimators are equally good and one network is merely later.",
        alt=f"Line chart of the error over the age of the newest sample, one line a run: {ends}.",
        keys=_keys(list(views), lines),
    )


def over_time(
    views: Mapping[str, HandView | None], disturbed: Mapping[str, Sequence[Disturbance]], is_driven: bool
) -> style.Figure | None:
    """Draw each run's error over time, with its disturbances in its colour; None where no run has any.

    Of runs that ``is_driven`` tells to have a live device, peaks do not compare.
    """
    found = {n: v for n, v in views.items() if v is not None and np.isfinite(v.errors_mm.get(v.active, [])).any()}
    if not found:
        return None
    end_s = max(float(view.track.t_ns.max()) for view in found.values()) / NS_PER_S
    fig = style.time_figure(style.time_range(end_s), "error, mm", 260)
    fig.y_range = DataRange1d(start=0, only_visible=True)
    for i, name in enumerate(views):
        if name not in found:
            continue
        view = found[name]
        error_mm = view.errors_mm[view.active]
        kept = worst(error_mm, MAX_TICKS)
        source = style.data(t=view.track.t_ns[kept] / NS_PER_S, error=error_mm[kept])
        line = fig.line("t", "error", source=source, line_color=SERIES[i].light, line_width=1.5)
        style.named(name, [line])
        mark_disturbances(fig, disturbed.get(name, ()), SERIES[i].light)
        style.hover(fig, line, (name, "@error{0.000} mm"), ("at", "@t{0.000} s"))
    largest = {n: v.errors_mm[v.active][v.track.scored] for n, v in found.items()}
    marked = any(disturbed.get(name) for name in found)
    compares = (
        "A live device moved another way in each run, so peaks at one place do not compare."
        if is_driven
        else "Runs of one source and seed show the same movement, so peaks at one place compare."
    )
    worst_of = ", ".join(f"{n} {number(float(np.nanmax(e)))} mm" for n, e in largest.items() if np.isfinite(e).any())
    return style.Figure(
        plots=(fig,),
        title="Error over time",
        caption=f"The active estimator's distance from the arm at each tick. Largest: {worst_of}. {compares}"
        + (" Shaded in a run's colour: its outages, and, dashed, changes made while it ran." if marked else ""),
        alt=f"Line chart of the 3D error over run time, one line a run. Largest: {worst_of}.",
        keys=_keys(list(views), found),
    )


def _keys(names: Sequence[str], drawn: Mapping[str, object]) -> tuple[style.Key, ...]:
    return tuple(style.Key(n, SERIES[i], "line", toggles=True) for i, n in enumerate(names) if n in drawn)


def _scored_errors(view: HandView | None) -> Array:
    error_mm = np.empty(0) if view is None else view.scored(view.errors_mm, view.active)
    return np.asarray(error_mm[np.isfinite(error_mm)])
