"""Sections of a run's report."""

from collections.abc import Sequence
from html import escape
from typing import get_args

from bokeh.models.ranges import Range1d

from common.channels import Direction
from common.units import NS_PER_MS, NS_PER_S
from deploy.logs.read.batches import link_fates
from deploy.report.measures.latency import round_trips, sample_latency, used_samples
from deploy.report.measures.network.requested import Requested
from deploy.report.measures.network.requested_pipeline import RequestedPipeline
from deploy.report.page.html_page import Section
from deploy.report.page.tiles import tiles
from deploy.report.plots.budget_bar import budget_bar, budget_ms
from deploy.report.plots.cdf_plot import delay_cdf, delay_curves, latency_cdf, latency_curves
from deploy.report.plots.clock_plot import clock_figure
from deploy.report.plots.delay_plot import delay_figure
from deploy.report.plots.error_age_plot import error_age_figure
from deploy.report.plots.error_plot import error_figure
from deploy.report.plots.hand_view import HandView
from deploy.report.plots.loss_plot import loss_figure
from deploy.report.plots.packets import LinkColumns, link_columns
from deploy.report.plots.path_plot import path_figure
from deploy.report.plots.plot_style import time_range
from deploy.report.plots.poles_plot import poles_figure
from deploy.report.plots.release_plot import release_figure
from deploy.report.plots.singular_plot import singular_figure
from deploy.report.plots.tracking_plot import tracking_figure
from deploy.report.run_view import RunView
from deploy.report.tables import html_tables as tables
from deploy.report.tables import network_tables as network
from deploy.report.tables.accuracy_tables import accuracy_table, more_accuracy
from deploy.report.tables.answer import accuracy_by_hand, answer
from deploy.report.tables.clock_table import clock_table
from deploy.report.tables.html_tables import nonbreaking_units
from deploy.report.tables.numbers import number
from deploy.report.tables.processor_table import processor_table
from deploy.report.tables.terminal import END_TO_END, run_warnings, send_rate_text, trained_on
from deploy.report.tables.verdict_table import verdict_tables
from deploy.report.verdict.verdict_text import validity_text
from patient_side.identification.validation import fit_text


def sections(run: RunView) -> list[Section]:
    """Return the sections of a run's report in reading order, the answer first."""
    requests = {d: Requested.of(run.scenario, d, run.logs) for d in get_args(Direction)}
    shared = {
        d: _shared_request(run, request, d) for d, request in requests.items()
    }  # before the columns fill memory
    links = {direction: link_columns(run.logs, direction) for direction in requests}
    views = run.hands()
    return [
        _answer(run),
        *_over_time(run, views, links, requests),
        _distributions(run, links, shared, any(request.varies for request in requests.values())),
        Section("age", "What age costs", [error_age_figure(view) for view in views], mark=run.mark, beside=True),
        Section("path", "Path in space", [path_figure(view) for view in views], mark=run.mark),
        _model(run),
        _network(run),
        Section("clocks", "Clocks", [clock_figure(run.logs.clocks)], before=clock_table(run.summary["clocks"])),
        Section("packets", "Packets and ticks", markup=_books(run)),
        Section("repeat", "Repeat this run", markup=_repeat(run)),
    ]


def _answer(run: RunView) -> Section:
    """Return the answer: words and figures, verdicts, the estimators beside hold, and the latency budget."""
    summary, active = run.summary, run.scenario.active_estimator
    problems = "".join(
        f'<li><strong class="bad">problem</strong> {escape(text)}</li>' for text in summary["problems"]
    )
    problems += "".join(
        f'<li><strong class="open">warning</strong> {escape(text)}</li>' for text in run_warnings(summary)
    )
    by_hand = accuracy_by_hand(summary, run.scenario)
    accuracy = "".join(accuracy_table(scores, f"{hand} hand", active) for hand, scores in by_hand.items())
    missing = '<p class="note">No estimate could be scored.</p>'
    markup = (
        f'<p class="answer">{escape(nonbreaking_units(answer(summary, run.scenario)))}</p>'
        + tiles(summary, run.scenario)
        + f'<p class="note">{escape(nonbreaking_units(_definition(run)))}</p>'
        + f"<p>{escape(validity_text(summary))}</p>"
        + (f'<ul class="problems">{problems}</ul>' if problems else "")
        + verdict_tables(summary["verdicts"])
        + (accuracy or missing)
        + f'<p class="note">hold repeats the newest arm position that arrived, the baseline without estimation. '
        f"The patient acted on {escape(active)}, marked above. R\u00b2 is 100 % when every estimate is right.</p>"
        + more_accuracy(by_hand, summary["orientation_deg"], active)
        + tables.redundancy_table(summary["redundancy"])
        + _budget(run)
    )
    return Section("answer", "The answer", markup=markup, mark=run.mark)


def _definition(run: RunView) -> str:
    """Return the definition of the end-to-end latency, with a remark on topology observer."""
    observer = " Here, in topology observer, commands cross unimpaired, so it is mostly theirs."
    return f"{END_TO_END}.{observer if run.scenario.topology == 'observer' else ''}"


def _budget(run: RunView) -> str:
    """Return the latency budget: the bar of means, and the percentiles of each part."""
    note = "The parts add up sample by sample, and so do their means; their medians and percentiles do not."
    if run.summary["mode"] == "twin":
        note += " In virtual time computing takes no time, so the surgeon's and the computing part are zero."
    bar = budget_bar(budget_ms(sample_latency(used_samples(run.logs, run.scenario.session, run.arms))))
    table = tables.latency_table(run.summary) + f'<p class="note">{note}</p>' + _age_of_information(run)
    return bar + tables.tick_mode_table(run.summary["tick_modes"]) + tables.folded("Each part in numbers", table)


def _age_of_information(run: RunView) -> str:
    age = run.summary["age_of_information_ms"]
    if age["mean"] is None:
        return ""
    return (
        f'<p class="note">Age of information, how old the newest sample is at any instant: mean '
        f"{number(age['mean'])} ms; just before the next one comes (peak): mean {number(age['peak']['mean'])} ms.</p>"
    )


def _over_time(
    run: RunView, views: Sequence[HandView], links: dict[Direction, LinkColumns], requests: dict[Direction, Requested]
) -> list[Section]:
    """Return the sections over run time, which share one axis."""
    x_range = _run_time(run, views, links)
    netem = run.logs.sides.get("netem")
    spans = {d: request.spans(netem.last_ns) if netem else [] for d, request in requests.items()}
    return [
        Section("tracking", "Truth and estimates", [tracking_figure(view, x_range) for view in views], mark=run.mark),
        Section("error", "Error", [error_figure(view, x_range) for view in views], mark=run.mark),
        Section("delay", "Delay and loss", [delay_figure(links, x_range, spans)]),
    ]


def _run_time(run: RunView, views: Sequence[HandView], links: dict[Direction, LinkColumns]) -> Range1d:
    last_s = [float(view.track.t_ns.max()) / NS_PER_S for view in views if view.n_ticks]
    last_s += [float(sent_s.max()) for link in links.values() if len(sent_s := link.all("sent_s"))]
    return time_range(max([run.scenario.duration_s, *last_s]))


def _shared_request(run: RunView, request: Requested, direction: Direction) -> RequestedPipeline | None:
    fates = link_fates(run.logs, direction)
    return request.shared(fates.at(~fates.foreign))


def _distributions(
    run: RunView, links: dict[Direction, LinkColumns], shared: dict[Direction, RequestedPipeline | None], varies: bool
) -> Section:
    trips_ms = round_trips(run.logs, run.scenario.session, run.arms) / NS_PER_MS
    whole_ms = sample_latency(used_samples(run.logs, run.scenario.session, run.arms)).end_to_end / NS_PER_MS
    limit_ms = run.scenario.limits.resolved().end_to_end_p99_ms
    figures = [
        latency_cdf(latency_curves(whole_ms, trips_ms), limit_ms),
        delay_cdf(delay_curves(links, shared, varies)),
        loss_figure(links),
        release_figure(links),
    ]
    return Section("distributions", "Distributions", figures, beside=True)


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


def _repeat(run: RunView) -> str:
    rows = [(name, version or "not installed") for name, version in run.versions.items()]
    return (
        "<p>The command of this run, and the resolved scenario in its folder, which gives every message the same "
        "fate again, live or in virtual time:</p>"
        f"<pre><code>{escape(run.summary['command'] or '-')}</code></pre>"
        "<pre><code>tis run scenario.yaml\ntis twin scenario.yaml</code></pre>"
        f"<p>The seed {run.summary['seed']} determines every random number of the run. scenario.yaml has every value "
        "of the scenario, defaults too, model.json the identified models, manifest.json the hashes of all files.</p>"
        + tables.table("Versions", ("package", "version"), rows, texts=(1,))
    )
