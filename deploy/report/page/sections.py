"""Sections of a run's report."""

from collections.abc import Sequence
from html import escape
from typing import get_args

from bokeh.models.ranges import Range1d

from tis.common.channels import Direction
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.deploy.logs.read.batches import link_fates
from tis.deploy.report.measures.latency import round_trips, sample_latency, used_samples
from tis.deploy.report.measures.network.disturbances import Disturbance, disturbances
from tis.deploy.report.measures.network.requested import Requested
from tis.deploy.report.measures.network.requested_pipeline import RequestedPipeline
from tis.deploy.report.measures.safety import set_points
from tis.deploy.report.page.answer_sections import (
    accuracy_section,
    answer_section,
    latency_section,
    requirements_section,
)
from tis.deploy.report.page.html_page import Section
from tis.deploy.report.plots.cdf_plot import delay_cdf, delay_curves, latency_cdf, latency_curves
from tis.deploy.report.plots.clock_plot import clock_figure
from tis.deploy.report.plots.delay_plot import delay_figure
from tis.deploy.report.plots.disturbance_marks import marked
from tis.deploy.report.plots.error_age_plot import error_age_figure, turn_age_figure
from tis.deploy.report.plots.error_plot import error_figure
from tis.deploy.report.plots.hand_view import HandView
from tis.deploy.report.plots.loss_plot import loss_figure
from tis.deploy.report.plots.packets import LinkColumns, link_columns
from tis.deploy.report.plots.path_3d import path_figure
from tis.deploy.report.plots.plot_style import Figure, time_range
from tis.deploy.report.plots.poles_plot import poles_figure
from tis.deploy.report.plots.release_plot import release_figure
from tis.deploy.report.plots.safety_plot import safety_figure
from tis.deploy.report.plots.singular_plot import singular_figure
from tis.deploy.report.plots.tracking_plot import tracking_figure
from tis.deploy.report.plots.turn_plot import turn_figure
from tis.deploy.report.run_view import RunView
from tis.deploy.report.tables import html_tables as tables
from tis.deploy.report.tables import network_tables as network
from tis.deploy.report.tables.clock_table import clock_table
from tis.deploy.report.tables.numbers import number
from tis.deploy.report.tables.processor_table import processor_table
from tis.deploy.report.tables.terminal import send_rate_text, trained_on
from tis.deploy.shell import run_dir
from tis.patient_side.identification.validation import fit_text


def sections(run: RunView) -> list[Section]:
    """Return the sections of a run's report in reading order, the answer first."""
    requests = {d: Requested.of(run.scenario, d, run.logs) for d in get_args(Direction)}
    shared = {
        d: _shared_request(run, request, d) for d, request in requests.items()
    }  # before the columns fill memory
    links = {direction: link_columns(run.logs, direction) for direction in requests}
    views = run.hands()
    x_range = _run_time(run, views, links)
    netem = run.logs.sides.get("netem")
    spans = {d: request.spans(netem.last_ns) if netem else [] for d, request in requests.items()}
    found = disturbances(run.logs, run.scenario)
    errors = [marked(draw(view, x_range), found, x_range) for view in views for draw in (error_figure, turn_figure)]
    return [
        answer_section(run, found),
        Section("error", "Error", errors, mark=run.mark),
        requirements_section(run),
        accuracy_section(run),
        _safety(run, views, x_range),
        Section("path", "The arm's movement", _movement(views, x_range, found), mark=run.mark),
        Section("delay", "Delay and loss", [delay_figure(links, x_range, spans)]),
        latency_section(run),
        _distributions(run, views, links, shared, any(request.varies for request in requests.values())),
        _model(run),
        _network(run),
        Section("clocks", "Clocks", [clock_figure(run.logs.clocks)], before=clock_table(run.summary["clocks"])),
        Section("packets", "Packets and ticks", markup=_books(run)),
        Section("repeat", "Repeat this run", markup=_repeat(run)),
    ]


def _safety(run: RunView, views: Sequence[HandView], x_range: Range1d) -> Section:
    """Return for each hand the set point beside the estimate, where the safety state was not always tracking."""
    each = [(view, set_points(run.logs, run.scenario, view.track, view.hand)) for view in views]
    figures = [safety_figure(view, driven, x_range) for view, driven in each]
    nothing = "Nothing to draw: the logs hold no set points."
    if any(driven is not None for _, driven in each):
        nothing = "Nothing to draw: at every tick the active estimate drove the arm as it was."
    return Section("safety", "What drove the arm", figures, mark=run.mark, nothing=nothing)


def _movement(views: Sequence[HandView], x_range: Range1d, found: Sequence[Disturbance]) -> list[Figure | None]:
    """Return each hand's path in space, then its position along each axis."""
    drawn = [(path_figure(view), marked(tracking_figure(view, x_range), found, x_range)) for view in views]
    return [figure for figures in drawn for figure in figures]


def _run_time(run: RunView, views: Sequence[HandView], links: dict[Direction, LinkColumns]) -> Range1d:
    last_s = [float(view.track.t_ns.max()) / NS_PER_S for view in views if view.n_ticks]
    last_s += [float(sent_s.max()) for link in links.values() if len(sent_s := link.all("sent_s"))]
    return time_range(max([run.scenario.duration_s, *last_s]))


def _shared_request(run: RunView, request: Requested, direction: Direction) -> RequestedPipeline | None:
    fates = link_fates(run.logs, direction)
    return request.shared(fates.at(~fates.foreign))


def _distributions(
    run: RunView,
    views: Sequence[HandView],
    links: dict[Direction, LinkColumns],
    shared: dict[Direction, RequestedPipeline | None],
    varies: bool,
) -> Section:
    trips_ms = round_trips(run.logs, run.scenario.session, run.arms) / NS_PER_MS
    whole_ms = sample_latency(used_samples(run.logs, run.scenario.session, run.arms)).end_to_end / NS_PER_MS
    limit_ms = run.scenario.limits.resolved().end_to_end_p99_ms
    figures = [
        latency_cdf(latency_curves(whole_ms, trips_ms), limit_ms),
        delay_cdf(delay_curves(links, shared, varies)),
        loss_figure(links),
        release_figure(links),
        *(draw(view) for view in views for draw in (error_age_figure, turn_age_figure)),
    ]
    return Section("distributions", "Distributions, and what age costs", figures, mark=run.mark, beside=True)


def _model(run: RunView) -> Section:
    summary = run.summary
    models = dict(summary.get("identification_by_hand") or {})
    if not models and "identification" in summary:
        models[run.scenario.source.hands[0]] = summary["identification"]
    part = run.scenario.identification
    figures = [singular_figure(model, f"{hand} hand", part) for hand, model in models.items()]
    figures += [poles_figure(model) for model in run.models]
    warnings = dict.fromkeys(text for model in models.values() for text in model["warnings"])
    markup = "".join(f'<p><strong class="open">warning</strong> {escape(text)}</p>' for text in warnings)
    rows = [
        (
            f"{hand} hand",
            model["method"],
            number(model["order"]),
            *(fit_text(value, 3) for value in model["fit_pct"]),
            f"{model['spectral_radius']:.4f}",
            number(model["block_rows"]),
            trained_on(model),
        )
        for hand, model in models.items()
    ]
    head = (
        "hand", "method", "order", "fit x, %", "fit y, %", "fit z, %", "spectral radius", "block rows", "trained on",
    )  # fmt: skip
    table = tables.table("The arm's model", head, rows, texts=(1, 8)) if rows else ""
    note = '<p class="note">Fit: the share of variance on validation rows that a simulation explains.</p>'
    return Section("model", "Identification", figures, table + note + markup, mark=run.mark, beside=True)


def _network(run: RunView) -> Section:
    """Return the requested and the realised network: verdict, both directions, and each key."""
    links = run.summary["links"]
    note = (
        '<p class="note">Requested: by the scenario. Decided: what the models drew. Realised: measured in netem. '
        "A run of losses is how many messages in a row were lost.</p>"
    )
    markup = network.requested_table(links) + note + network.release_table(links) + network.key_tables(links)
    return Section("network", "Requested and realised network", markup=network.fidelity_list(links) + markup)


def _books(run: RunView) -> str:
    """Return the tables of packets and ticks, with definitions of their terms."""
    summary = run.summary
    n_unlogged = sum(link["untold"] for link in summary["links"].values())
    rate = send_rate_text(summary["redundancy"])
    rejected = ", ".join(f"{side} {number(count)}" for side, count in summary["rejected"].items()) or "-"
    return (
        tables.packet_table(summary["links"])
        + '<p class="note">Dropped: by netem, as the scenario requests. Unplanned loss: lost on either side of '
        "netem. Foreign: messages of other programs on keys of the testbed."
        + (f" Left out, as they fall into gaps of damaged logs: {n_unlogged}." if n_unlogged else "")
        + (f" The surgeon sent {rate} (payload and attachment)." if rate else "")
        + "</p>"
        + tables.tick_table(summary)
        + f'<p class="note">A tick that has not begun when the next one is due is missed. Samples that arrived '
        f"but were never the freshest: {number(summary['superseded'])}. Messages rejected: {escape(rejected)}.</p>"
        + processor_table(summary["processors"])
    )


def _link(name: str) -> str:
    return f'<a href="{name}">{name}</a>'


def _repeat(run: RunView) -> str:
    rows = [(name, version or "not installed") for name, version in run.versions.items()]
    return (
        "<p>The command of this run, and the resolved scenario in its folder, which gives every message the same "
        "fate again, live or in virtual time:</p>"
        f"<pre><code>{escape(run.summary['command'] or '-')}</code></pre>"
        "<pre><code>tis run scenario.yaml\ntis twin scenario.yaml</code></pre>"
        f"<p>The seed {run.summary['seed']} determines every random number of the run. In its folder, "
        f"beside this page: {_link(run_dir.SCENARIO_FILE)} has every value of the scenario, defaults too, "
        f"{_link(run_dir.model_file(run.logs.run_dir).name)} the identified models, "
        f"{_link(run_dir.SUMMARY_FILE)} every figure, "
        f"{_link(run_dir.MANIFEST_FILE)} the hashes of all files.</p>"
        + tables.table("Versions", ("package", "version"), rows, texts=(1,))
    )
