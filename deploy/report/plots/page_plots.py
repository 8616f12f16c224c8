"""The figures of a run's page, section by section, on one axis of run time, with the disturbances of the run."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

from bokeh.models import GridPlot
from bokeh.models.ranges import Range1d
from bokeh.plotting import figure

from tis.common.channels import Direction
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.packets import link_fates
from tis.deploy.present import plot_style as style
from tis.deploy.present.palette import AWAY, CHANGED, OUTAGE, STALL, Tone
from tis.deploy.present.plot_style import Figure, time_range
from tis.deploy.report.plots.clocks import clock_figure
from tis.deploy.report.plots.delay import delay_figure
from tis.deploy.report.plots.distributions import delay_cdf, latency_cdf, loss_figure, release_figure
from tis.deploy.report.plots.errors import age_figure, error_figure, errors_of, safety_figure
from tis.deploy.report.plots.models import poles_figure, singular_figure
from tis.deploy.report.plots.movement import path_figure, tracking_figure
from tis.deploy.report.plots.sight import sight_figure
from tis.deploy.report.plots.touch import touch_figure
from tis.deploy.report.run_view import RunView
from tis.deploy.report.subjects.network.disturbances import Disturbance
from tis.deploy.report.subjects.network.key_figures import link_columns
from tis.deploy.report.subjects.network.requested import Requested
from tis.deploy.report.subjects.network.requested_pipeline import RequestedPipeline
from tis.deploy.report.subjects.safety import set_points

_MAX_MARKS: Final = 40
_TONES: Final[dict[str, Tone]] = {"outage": OUTAGE, "stall": STALL, "change": CHANGED, "absence": AWAY}
_NAMES: Final = {
    "outage": "outage", "stall": "stall", "change": "changed while running", "absence": "a side was away",
}  # fmt: skip


def marked(drawn: style.Figure | None, found: Sequence[Disturbance], x_range: Range1d) -> style.Figure | None:
    """Return a figure with the disturbances in each of its panels over ``x_range``, and their keys."""
    if drawn is None or not found:
        return drawn
    kinds = [kind for kind in _TONES if any(one.kind == kind for one in found)]
    for plot in drawn.plots:
        # from top to bottom: the order of `select` is that of a set, another one in each process
        for panel in (child[0] for child in plot.children) if isinstance(plot, GridPlot) else [plot]:
            if isinstance(panel, figure) and panel.x_range is x_range:
                for kind in kinds:
                    mark_disturbances(panel, [one for one in found if one.kind == kind], _TONES[kind].light, 1.0)
    return replace(drawn, keys=(*drawn.keys, *(style.Key(_NAMES[kind], _TONES[kind], "bar") for kind in kinds)))


def mark_disturbances(panel: figure, found: Sequence[Disturbance], colour: str, alpha: float = 0.15) -> None:
    """Shade the time of each disturbance, with dashed ends unless nothing is sent; of very many the longest."""
    longest = sorted(found, key=lambda one: one.begin_s - one.end_s)[:_MAX_MARKS]
    for one in longest:
        dash = "solid" if one.kind in ("outage", "stall") else "dashed"
        edge: dict[str, Any] = {"line_color": colour, "line_alpha": min(2 * alpha, 1.0), "line_dash": dash}
        style.shade(panel, one.begin_s, one.end_s, colour, fill_alpha=alpha, **edge)


def page_figures(run: RunView) -> dict[str, list[Figure | None]]:
    """Return the figures of a run's page by the anchor of their section; what several need is computed once."""
    logs, measured, views, part = run.logs, run.measured, list(run.hands.values()), run.scenario.identification
    requests, netem = measured.requests, logs.sides.get("netem")
    # before the columns fill memory
    shared = {way: _shared(logs, way, request) for way, request in requests.items()}
    varies = any(request.varies for request in requests.values())
    spans = {way: request.spans(netem.last_ns) if netem else [] for way, request in requests.items()}
    links = {way: link_columns(logs, way) for way in requests}
    last_s = [float(view.track.t_ns.max()) / NS_PER_S for view in views if view.n_ticks]
    last_s += [float(link.sent_s[-1]) for link in links.values() if len(link.sent_s)]
    x_range = time_range(max([run.scenario.duration_s, *last_s]))
    driven = [set_points(logs, run.scenario, view.track, view.hand) for view in views]
    errors = [one for view in views for one in errors_of(view)]
    latency_ms, trips_ms = (ns / NS_PER_MS for ns in (measured.latency.end_to_end, measured.round_trips_ns))
    limit_ms = run.scenario.limits.resolved().end_to_end_p99_ms

    def with_marks(figure: Figure | None) -> Figure | None:
        return marked(figure, run.disturbances, x_range)

    moved = [
        (_of(view.hand, path_figure(view)), _of(view.hand, with_marks(tracking_figure(view, x_range)), folds=True))
        for view in views
    ]
    return {
        "touch": [_of(view.hand, with_marks(touch_figure(run, view, x_range))) for view in views],
        "sight": [with_marks(sight_figure(run, x_range))],
        "error": [_of(one.view.hand, with_marks(error_figure(one, x_range))) for one in errors],
        "safety": [
            _of(view.hand, safety_figure(view, its, x_range)) for view, its in zip(views, driven, strict=True)
        ],
        "path": [figure for figures in moved for figure in figures],
        "delay": [delay_figure(links, x_range, spans)],
        "distributions": [
            latency_cdf(latency_ms, trips_ms, limit_ms),
            _of("", delay_cdf(links, shared, varies), folds=True),
            _of("", loss_figure(links), folds=True),
            _of("", release_figure(links), folds=True),
            *(_of(one.view.hand, age_figure(one), folds=bool(one.mark)) for one in errors),
        ],
        "model": [
            figure
            for hand, model in run.models.items()
            for figure in (
                _of(hand, singular_figure(model, f"{hand} hand", part), folds=True),
                *(_of(hand, poles_figure(one), folds=True) for one in measured.models if one.hand == hand),
            )
        ],
        "clocks": [clock_figure(logs.clocks)],
    }


def _of(part: str, drawn: Figure | None, folds: bool = False) -> Figure | None:
    """Return a figure as one of a part of the page."""
    return None if drawn is None else replace(drawn, of=part, folds=folds)


def _shared(logs: RunLogs, direction: Direction, request: Requested) -> RequestedPipeline | None:
    fates = link_fates(logs, direction)
    return request.shared_by(fates.at(~fates.foreign))
