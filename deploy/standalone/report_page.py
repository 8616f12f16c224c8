"""Page ``report.html`` of a standalone netem: requested and realised network, message by message."""

from collections.abc import Mapping
from html import escape
from typing import Final, get_args

from tis.common.channels import Direction
from tis.common.runtime.process import repeatable
from tis.deploy.logs.read.packets import link_fates
from tis.deploy.present.page import Page, Section, note, page_html, problem_list
from tis.deploy.present.plot_style import time_range
from tis.deploy.report.contents import versions_table
from tis.deploy.report.plots.delay import delay_figure
from tis.deploy.report.plots.distributions import delay_cdf, loss_figure, release_figure
from tis.deploy.report.subjects.audit import audit_markup
from tis.deploy.report.subjects.network.key_figures import link_columns
from tis.deploy.report.subjects.network.link_tables import (
    delay_table,
    fidelity_list,
    key_tables,
    packet_table,
)
from tis.deploy.report.subjects.network.requested import Requested
from tis.deploy.report.subjects.processors import processor_table
from tis.deploy.standalone.command import NetemSummary, named_changes
from tis.deploy.standalone.standalone_run import StandaloneRun, network_lines
from tis.netem.expected.synopsis import direction_label

_TITLE: Final = "netem between two networks"


def report_html(run: StandaloneRun, summary: NetemSummary, versions: Mapping[str, str | None]) -> str:
    """Return the page, without the figures that the log has no data for."""
    audited = audit_markup(run.logs)
    about = [Section(anchor="audit", title="Who connected, and who was refused", markup=audited)] if audited else []
    sections = [_answer(run, summary), _network(run, summary), *about, _repeat(summary, versions)]
    return page_html(Page(f"{_TITLE}: report", _TITLE, _tags(summary), sections))


def _tags(summary: NetemSummary) -> list[tuple[str, str]]:
    tags = [("valid measurement", "good") if summary.valid else ("not a valid measurement", "bad")]
    tags += [
        ("live: real processes, real time", ""),
        (f"seed {summary.seed}", ""),
        (f"{summary.duration_s:.1f} s", ""),
    ]
    return tags + [(text, "") for text in (summary.begun, summary.profile) if text]


def _answer(run: StandaloneRun, summary: NetemSummary) -> Section:
    verdict = "This is a valid measurement." if summary.valid else "This is not a valid measurement:"
    request = "".join(f"<li>{escape(line)}</li>" for line in [*network_lines(run), *named_changes(summary.changes)])
    markup = (
        f"<p>{escape('Crossing: ' + ', '.join(summary.keys))}</p><ul>{request}</ul><p>{verdict}</p>"
        + problem_list(summary.problems)
        + fidelity_list(summary.links, "was requested")
    )
    return Section(anchor="answer", title="The answer", markup=markup)


def _network(run: StandaloneRun, summary: NetemSummary) -> Section:
    links = {direction: link_columns(run.logs, direction) for direction in get_args(Direction)}
    requests = {direction: Requested.of(run.request, direction, run.logs) for direction in links}
    spans = {direction: request.spans(run.log.last_ns) for direction, request in requests.items()}
    request = {d: request.shared_by(link_fates(run.logs, d)) for d, request in requests.items()}
    figures = [
        delay_figure(links, time_range(summary.duration_s), spans, {way: direction_label(way) for way in links}),
        delay_cdf(links, request, any(request.varies for request in requests.values())),
        loss_figure(links),
        release_figure(links),
    ]
    words = "Only the logs of senders and receivers would tell what happened before and behind netem."
    markup = packet_table(summary.links).html() + note(words) + delay_table(summary.links, "by the options").html()
    processors = processor_table(summary.processors)
    markup += key_tables(summary.links) + (processors.html() if processors.rows else "")
    return Section(anchor="network", title="Delay and loss", figures=figures, markup=markup)


def _repeat(summary: NetemSummary, versions: Mapping[str, str | None]) -> Section:
    command = repeatable(summary.command, " --log") or "-"
    live = note("Changes made while it ran are not repeated by it.") if summary.changes else ""
    markup = (
        "<p>The command; the network that was used stands in network.yaml, for --scenario-network, and the same seed "
        "gives each message of a key the same fate again:</p>"
        f"<pre><code>{escape(command)}</code></pre>" + live + versions_table(versions).html()
    )
    return Section(anchor="repeat", title="Repeat this", markup=markup)
