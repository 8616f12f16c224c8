"""Page ``report.html`` of a standalone netem: requested and realised network, message by message."""

from collections.abc import Mapping
from html import escape
from typing import Any, get_args

from tis.common.channels import Direction
from tis.deploy.logs.read.batches import link_fates
from tis.deploy.report.measures.network.requested import Requested
from tis.deploy.report.page.html_page import Page, Section, page_html
from tis.deploy.report.plots.cdf_plot import delay_cdf, delay_curves
from tis.deploy.report.plots.delay_plot import delay_figure
from tis.deploy.report.plots.loss_plot import loss_figure
from tis.deploy.report.plots.packets import link_columns
from tis.deploy.report.plots.plot_style import time_range
from tis.deploy.report.plots.release_plot import release_figure
from tis.deploy.report.tables import html_tables as tables
from tis.deploy.report.tables import network_tables as network
from tis.deploy.report.tables.processor_table import processor_table
from tis.deploy.standalone.standalone_run import StandaloneRun, network_lines

_TITLE = "netem between two networks"


def report_html(run: StandaloneRun, summary: Mapping[str, Any], versions: Mapping[str, str | None]) -> str:
    """Return the page, without the figures that the log has no data for."""
    sections = [_answer(run, summary), _network(run, summary), _repeat(summary, versions)]
    return page_html(Page(f"{_TITLE}: report", _TITLE, _tags(summary), sections))


def _tags(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    tags = [("valid measurement", "good") if summary["valid"] else ("not a valid measurement", "bad")]
    tags += [("live: real processes, real time", ""), (f"seed {summary['seed']}", "")]
    tags += [(f"{summary['duration_s']:.1f} s", "")]
    return tags + [(text, "") for text in (summary["begun"], summary["profile"]) if text]


def _answer(run: StandaloneRun, summary: Mapping[str, Any]) -> Section:
    verdict = "This is a valid measurement." if summary["valid"] else "This is not a valid measurement:"
    problems = "".join(
        f'<li><strong class="bad">problem</strong> {escape(text)}</li>' for text in summary["problems"]
    )
    request = "".join(f"<li>{escape(line)}</li>" for line in network_lines(run))
    markup = (
        f"<p>{escape('Crossing: ' + ', '.join(summary['keys']))}</p><ul>{request}</ul><p>{verdict}</p>"
        + (f'<ul class="problems">{problems}</ul>' if problems else "")
        + network.fidelity_list(summary["links"], "was requested")
    )
    return Section(anchor="answer", title="The answer", markup=markup)


def _network(run: StandaloneRun, summary: Mapping[str, Any]) -> Section:
    links = {direction: link_columns(run.logs, direction) for direction in get_args(Direction)}
    requests = {direction: Requested.of(run.request, direction, run.logs) for direction in links}
    spans = {direction: request.spans(run.log.last_ns) for direction, request in requests.items()}
    request = {d: request.shared(link_fates(run.logs, d)) for d, request in requests.items()}
    figures = [
        delay_figure(links, time_range(summary["duration_s"]), spans),
        delay_cdf(delay_curves(links, request, any(request.varies for request in requests.values()))),
        loss_figure(links),
        release_figure(links),
    ]
    note = (
        '<p class="note">Requested: by the options. Decided: drawn by the models. Realised: measured in netem, '
        "from a message's arrival there to its leaving. Release error: how much later than decided it left. Only the "
        "logs of senders and receivers would tell what happened before and behind netem.</p>"
    )
    books = dict(summary["links"])
    markup = tables.packet_table(books) + network.requested_table(books) + note + network.key_tables(books)
    markup += processor_table(summary["processors"])
    return Section(anchor="network", title="Delay and loss", figures=figures, markup=markup)


def _repeat(summary: Mapping[str, Any], versions: Mapping[str, str | None]) -> Section:
    rows = [(name, version or "not installed") for name, version in versions.items()]
    markup = (
        "<p>The command; the network that was used stands in network.yaml, for --scenario-network, and the same seed "
        "gives each message of a key the same fate again:</p>"
        f"<pre><code>{escape(summary['command'] or '-')}</code></pre>"
        + tables.table("Versions", ("package", "version"), rows, texts=(1,))
    )
    return Section(anchor="repeat", title="Repeat this", markup=markup)
