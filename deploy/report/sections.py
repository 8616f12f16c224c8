"""What the report says about a run, section by section; how it becomes a page is another module's business."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Any, get_args

from bokeh.models.ranges import Range1d

from common.channels import FOLLOWER, Arm, Direction, Hand
from common.scenario import Scenario
from common.units import NS_PER_MS, NS_PER_S
from deploy.report import html_tables as tables
from deploy.report.answer import accuracy_by_hand, answer
from deploy.report.asked import Asked
from deploy.report.budget_plot import budget_figure
from deploy.report.cdf_plot import delay_cdf, latency_cdf
from deploy.report.delay_plot import delay_figure
from deploy.report.error_plot import error_figure
from deploy.report.latency import round_trips, ways
from deploy.report.load import RunLogs
from deploy.report.loss_plot import loss_figure
from deploy.report.packets import LinkColumns, link_columns
from deploy.report.plot_style import Figure, time_range
from deploy.report.release_plot import release_figure
from deploy.report.requested import Requested
from deploy.report.singular_plot import singular_figure
from deploy.report.table import number
from deploy.report.tracking import track_of_hand
from deploy.report.tracking_plot import tracking_figure


@dataclass(frozen=True)
class RunView:
    """A run as its report sees it: its logs as far as there are any, its summary, and which arm each hand drove."""

    logs: RunLogs
    scenario: Scenario
    summary: dict[str, Any]
    arms: dict[Hand, Arm]
    versions: dict[str, str | None]

    @property
    def synthetic(self) -> bool:
        """Whether the movement was computed and not recorded from a person."""
        return self.scenario.source.synthetic


@dataclass(frozen=True)
class Section:
    """A part of the page: figures, and before and after them markup that is safe already."""

    anchor: str
    title: str
    figures: Sequence[Figure | None]
    markup: str = ""
    moves: bool = False
    beside: bool = False
    before: str = ""


def arms_of(scenario: Scenario, found: dict[Hand, Arm]) -> dict[Hand, Arm]:
    """Return the arm of each hand of the scenario: the identified one, else the one that usually follows it."""
    return {hand: found.get(hand, FOLLOWER[hand]) for hand in scenario.source.hands}


def sections(run: RunView) -> list[Section]:
    """Return the sections of a run's report in the order in which they are read; the answer is the first."""
    return [
        Section("answer", "The answer", [], _answer(run), moves=True),
        *_over_time(run),
        *_latency(run),
        _model(run),
        Section("packets", "Packets and ticks", [], tables.packet_table(run.summary["links"]) + _books(run)),
        Section("repeat", "Repeat this run", [], _repeat(run)),
    ]


def _answer(run: RunView) -> str:
    """Return the answer in plain words, the verdict with its reasons, the limits, and the estimators beside hold."""
    summary, active = run.summary, run.scenario.active_estimator
    verdict = "This run is a valid measurement." if summary["valid"] else "This run is not a valid measurement:"
    problems = "".join(
        f'<li><strong class="bad">problem</strong> {escape(text)}</li>' for text in summary["problems"]
    )
    by_hand = accuracy_by_hand(summary, run.scenario)
    accuracy = "".join(tables.accuracy_table(scores, f"{hand} hand", active) for hand, scores in by_hand.items())
    missing = '<p class="note">No estimate could be scored.</p>'
    return (
        f'<p class="answer">{escape(answer(summary, run.scenario))}</p>'
        f"<p>{verdict}</p>"
        + (f'<ul class="problems">{problems}</ul>' if problems else "")
        + (tables.limits_list(summary["limits"]) or '<p class="note">The scenario sets no limits.</p>')
        + (accuracy or missing)
        + f'<p class="note">hold repeats the newest arm position that arrived: what one has without estimating. '
        f"The patient acted on {escape(active)}, marked above. R\u00b2 is 100 % when every estimate is right.</p>"
    )


def _over_time(run: RunView) -> list[Section]:
    """Return the sections over run time, which share one axis."""
    logs, active = run.logs, run.scenario.active_estimator
    links = {direction: link_columns(logs, direction) for direction in get_args(Direction)}
    tracks = {hand: track_of_hand(logs, run.scenario, hand) for hand in run.arms}
    last_s = [float(track.t_ns.max()) / NS_PER_S for track in tracks.values() if len(track.t_ns)]
    last_s += [float(sent_s.max()) for link in links.values() if len(sent_s := link.all("sent_s"))]
    x_range = time_range(max([run.scenario.duration_s, *last_s]))
    origin = ", synthetic" if run.synthetic else ""
    which = {hand: f"{hand} hand ({arm}{origin})" for hand, arm in run.arms.items()}
    tracking = [tracking_figure(track, active, which[hand], x_range) for hand, track in tracks.items()]
    errors = [error_figure(track, active, which[hand], x_range) for hand, track in tracks.items()]
    return [
        Section("tracking", "Truth and estimates", tracking, moves=True),
        Section("error", "Error", errors, moves=True),
        _network(run, links, x_range),
    ]


def _network(run: RunView, links: dict[Direction, LinkColumns], x_range: Range1d) -> Section:
    """Return what was asked of the network and what it did: the verdict, how it went, and each key in numbers."""
    requests = {d: Requested.of(run.scenario, d, run.logs) for d in links}
    netem = run.logs.sides.get("netem")
    spans = {d: request.spans(netem.last_ns) if netem else [] for d, request in requests.items()}
    asked: dict[Direction, Asked | None] = {}
    for direction, request in requests.items():
        alike = {request.pipeline(key) for key in links[direction].keys}
        asked[direction] = request.base(next(iter(links[direction].keys))) if len(alike) == 1 else None
    varies = any(request.varies for request in requests.values())
    figures = [
        delay_figure(links, x_range, spans),
        delay_cdf(links, asked, varies),
        loss_figure(links),
        release_figure(links),
    ]
    summary = run.summary["links"]
    return Section(
        "delay",
        "Delay and loss",
        figures,
        tables.key_tables(summary),
        before=tables.verdict_list(summary),
    )


def _latency(run: RunView) -> list[Section]:
    trips_ms = round_trips(run.logs, run.scenario.session, run.arms) / NS_PER_MS
    whole_ms = ways(run.logs, run.scenario.session, run.arms).end_to_end / NS_PER_MS
    figures = [
        budget_figure(run.summary["latency_ms"]),
        latency_cdf(whole_ms, trips_ms, run.scenario.limits.resolved().end_to_end_p99_ms),
    ]
    note = "The parts add up sample by sample; their percentiles do not."
    if run.summary["mode"] == "twin":
        note += " In virtual time computing takes no time, so the surgeon's and the computing part are zero."
    note = f'<p class="note">{note}</p>'
    return [Section("latency", "Latency", figures, tables.latency_table(run.summary["latency_ms"]) + note)]


def _model(run: RunView) -> Section:
    summary = run.summary
    models = dict(summary.get("identification_by_hand") or {})
    if not models and "identification" in summary:
        models[run.scenario.source.hands[0]] = summary["identification"]
    figures = [singular_figure(model, f"{hand} hand") for hand, model in models.items()]
    warnings = dict.fromkeys(text for model in models.values() for text in model["warnings"])
    markup = "".join(f'<p><strong class="open">warning</strong> {escape(text)}</p>' for text in warnings)
    return Section("model", "Identification", figures, markup, moves=True, beside=len(models) > 1)


def _books(run: RunView) -> str:
    """Return the tables beside the packets', with what their words mean."""
    summary = run.summary
    rejected = ", ".join(f"{side} {number(count)}" for side, count in summary["rejected"].items()) or "-"
    return (
        '<p class="note">Dropped: by netem, as the scenario asks. Unplanned loss: vanished on either side of netem, '
        "which nobody asked for. Foreign: not ours, on our keys.</p>"
        + tables.delay_table(summary["links"])
        + '<p class="note">Decided: what the models drew. Realised: measured in netem. Release error: how much '
        "later than decided it left.</p>"
        + tables.tick_table(summary)
        + f'<p class="note">A tick that did not begin before the next one was due is missed. Samples that arrived '
        f"but were never the freshest: {number(summary['superseded'])}. Messages rejected: {escape(rejected)}.</p>"
    )


def _repeat(run: RunView) -> str:
    rows = [(name, version or "not installed") for name, version in run.versions.items()]
    return (
        "<p>The command of this run, and, in its folder, the scenario that it resolved to, which gives every message "
        "the same fate again, live or in virtual time:</p>"
        f"<pre><code>{escape(run.summary['command'] or '-')}</code></pre>"
        "<pre><code>tis run scenario.yaml\ntis twin scenario.yaml</code></pre>"
        f"<p>The seed {run.summary['seed']} decides every random number of the run; every value of the scenario, "
        "defaults too, stands in scenario.yaml, what was identified in model.json, hashes of all files in "
        "manifest.json.</p>" + tables.table("Versions", ("", "version"), rows)
    )
