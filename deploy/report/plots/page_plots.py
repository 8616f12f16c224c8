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


class RunPlots:
    """The figures of a run; what several of them need is computed once."""

    def __init__(self, run: RunView) -> None:
        self._run = run
        self._hands = list(run.hands.values())
        requests, netem = run.measured.requests, run.logs.sides.get("netem")
        # before the columns fill memory
        self._shared = {way: _shared(run.logs, way, request) for way, request in requests.items()}
        self._varies = any(request.varies for request in requests.values())
        self._spans = {way: request.spans(netem.last_ns) if netem else [] for way, request in requests.items()}
        self._links = {way: link_columns(run.logs, way) for way in requests}
        last_s = [float(view.track.t_ns.max()) / NS_PER_S for view in self._hands if view.n_ticks]
        last_s += [float(sent_s.max()) for link in self._links.values() if len(sent_s := link.all("sent_s"))]
        self._x_range = time_range(max([run.scenario.duration_s, *last_s]))
        self._driven = [set_points(run.logs, run.scenario, view.track, view.hand) for view in self._hands]

    def errors(self) -> list[Figure | None]:
        """Return for each hand the errors of position and orientation over time."""
        return [self._marked(error_figure(one, self._x_range)) for view in self._hands for one in errors_of(view)]

    def safety(self) -> list[Figure | None]:
        """Return for each hand the set point beside the estimate, where the safety state was not always tracking."""
        pairs = zip(self._hands, self._driven, strict=True)
        return [safety_figure(view, driven, self._x_range) for view, driven in pairs]

    @property
    def without_safety(self) -> str:
        """Return why no set point is drawn."""
        if all(driven is None for driven in self._driven):
            return "Nothing to draw: the logs hold no set points."
        return "Nothing to draw: at every tick the active estimate drove the arm as it was."

    def movement(self) -> list[Figure | None]:
        """Return each hand's path in space, then its position along each axis."""
        drawn = [(path_figure(view), self._marked(tracking_figure(view, self._x_range))) for view in self._hands]
        return [figure for figures in drawn for figure in figures]

    def delay(self) -> list[Figure | None]:
        """Return the delays over time."""
        return [delay_figure(self._links, self._x_range, self._spans)]

    def distributions(self) -> list[Figure | None]:
        """Return the distributions of latency, delay, losses and release errors, and the errors by age."""
        measured = self._run.measured
        latency_ms, trips_ms = (ns / NS_PER_MS for ns in (measured.latency.end_to_end, measured.round_trips_ns))
        limit_ms = self._run.scenario.limits.resolved().end_to_end_p99_ms
        return [
            latency_cdf(latency_ms, trips_ms, limit_ms),
            delay_cdf(self._links, self._shared, self._varies),
            loss_figure(self._links),
            release_figure(self._links),
            *(age_figure(one) for view in self._hands for one in errors_of(view)),
        ]

    def models(self) -> list[Figure | None]:
        """Return the singular values and the poles of the identified models."""
        part = self._run.scenario.identification
        drawn = [singular_figure(model, f"{hand} hand", part) for hand, model in self._run.models.items()]
        return [*drawn, *map(poles_figure, self._run.measured.models)]

    def clocks(self) -> list[Figure | None]:
        """Return the exchanges of the clocks."""
        return [clock_figure(self._run.logs.clocks)]

    def _marked(self, figure: Figure | None) -> Figure | None:
        return marked(figure, self._run.disturbances, self._x_range)


def _shared(logs: RunLogs, direction: Direction, request: Requested) -> RequestedPipeline | None:
    fates = link_fates(logs, direction)
    return request.shared_by(fates.at(~fates.foreign))
