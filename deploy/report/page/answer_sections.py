"""Sections of a run's report that answer: the answer itself, requirements, accuracy, and where the time goes."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from tis.common.scenario import Scenario
from tis.deploy.report.measures.latency import sample_latency, used_samples
from tis.deploy.report.measures.network.disturbances import Disturbance, disturbances_text
from tis.deploy.report.page.html_page import Section
from tis.deploy.report.page.network_picture import DirectionFigures, network_picture
from tis.deploy.report.plots.budget_bar import budget_bar, budget_ms
from tis.deploy.report.run_view import RunView
from tis.deploy.report.tables import html_tables as tables
from tis.deploy.report.tables.accuracy_tables import accuracy_table, more_accuracy
from tis.deploy.report.tables.answer import accuracy_by_hand, answer
from tis.deploy.report.tables.display_table import display_table
from tis.deploy.report.tables.html_tables import nonbreaking_units
from tis.deploy.report.tables.numbers import figure, number
from tis.deploy.report.tables.orientation_table import orientation_table
from tis.deploy.report.tables.redundancy_rows import sample_loss_text
from tis.deploy.report.tables.run_warnings import run_warnings
from tis.deploy.report.tables.terminal import END_TO_END
from tis.deploy.report.tables.verdict_table import outcome_list, verdict_tables
from tis.deploy.report.verdict.verdict_text import validity_text

# Headline figures of the report: latency, loss, accuracy, missed ticks.


def tiles(summary: dict[str, Any], scenario: Scenario) -> str:
    """Return four figures of the summary with their meaning; a dash for an unknown one."""
    parts = [_late(summary), _lossy(summary), _accurate(summary, scenario), _punctual(summary)]
    items = "".join(
        f'<div><dt>{escape(name)}</dt><dd class="value">{escape(value)} <small>{escape(unit)}</small></dd>'
        f'<dd class="beside">{escape(nonbreaking_units(beside))}</dd></div>'
        for name, value, unit, beside in parts
    )
    return f'<dl class="tiles">{items}</dl>'


def _late(summary: dict[str, Any]) -> tuple[str, str, str, str]:
    median, most = (figure(summary, "latency_ms.end_to_end", name) for name in ("p50", "p99"))
    return (
        "How late",
        median,
        "ms",
        f"median, end to end: from newest sample to estimate; in 99 of 100 cases at most {most} ms (p99)",
    )


def _lossy(summary: dict[str, Any]) -> tuple[str, str, str, str]:
    forward, feedback = (summary["links"][direction]["loss_pct"] for direction in ("forward", "feedback"))
    longest = summary["links"]["forward"]["loss_runs"]["longest"]
    beside = f"of the packets to the patient, up to {number(longest)} in a row; {number(feedback)} % of those back"
    samples = sample_loss_text(summary["redundancy"])
    return "How lossy", number(forward), "%", beside if samples is None else f"{beside}; {samples}"


def _accurate(summary: dict[str, Any], scenario: Scenario) -> tuple[str, str, str, str]:
    by_hand, active = accuracy_by_hand(summary, scenario), scenario.active_estimator
    found = [(hand, scores[active]) for hand, scores in by_hand.items() if active in scores]
    value = " / ".join(number(entry["rmse_3d_mm"]) for _, entry in found) or "-"
    ratios = [entry["ratio_to_hold"] for _, entry in found]
    hands = f" ({' / '.join(hand for hand, _ in found)} hand)" if len(found) > 1 else ""
    if not ratios or None in ratios or active == "hold":
        return "How accurate", value, "mm", f"RMSE of {active}, in 3D{hands}"
    share = " / ".join(f"{100 * ratio:.0f}" for ratio in ratios)
    beside = f"RMSE of {active}, in 3D{hands}: {share} % of the error of repeating the last position (hold)"
    return "How accurate", value, "mm", beside


def _punctual(summary: dict[str, Any]) -> tuple[str, str, str, str]:
    ticks = summary["ticks"]
    planned, count = ticks.get("planned"), ticks["count"]
    cut = f" ({planned} were planned)" if planned is not None and count is not None and count < planned else ""
    beside = f"of {number(count)} ticks of the patient{cut}, at {ticks['rate_hz']} Hz"
    if missed := summary["surgeon_ticks"]["missed"]:
        beside += f"; the surgeon missed {missed}"
    if summary["mode"] == "twin":
        beside += "; virtual time has no missed ticks"
    return "Ticks missed", number(ticks["missed"]), "", beside


def answer_section(run: RunView, found: Sequence[Disturbance]) -> Section:
    """Return the answer: words and figures, validity with problems and warnings, and the verdicts in short.

    What disturbed the network, ``found``, is said first.
    """
    summary = run.summary
    disturbed = disturbances_text("this run", [one for one in found if one.kind != "absence"])  # warnings name these
    problems = "".join(
        f'<li><strong class="bad">problem</strong> {escape(text)}</li>' for text in summary["problems"]
    )
    problems += "".join(
        f'<li><strong class="open">warning</strong> {escape(text)}</li>' for text in run_warnings(summary)
    )
    markup = (
        (f"<p>{escape(nonbreaking_units(disturbed))}</p>" if disturbed else "")
        + f'<p class="answer">{escape(nonbreaking_units(answer(summary, run.scenario)))}</p>'
        + tiles(summary, run.scenario)
        + '<div class="sidebyside"><div>'
        + network_picture({d: _direction(link) for d, link in summary["links"].items()}, {})
        + f'<p class="note">{escape(nonbreaking_units(_definition(run)))}</p></div>'
        + f"<div><p>{escape(validity_text(summary))}</p>"
        + (f'<ul class="problems">{problems}</ul>' if problems else "")
        + f"{outcome_list(summary['verdicts'], summary['ticks']['rate_hz'])}</div></div>"
    )
    return Section("answer", "The answer", markup=markup, mark=run.mark)


def _direction(link: Mapping[str, Any]) -> DirectionFigures:
    """Return a direction's figures of the whole run for the picture."""
    outage_s = (link.get("conditions") or {}).get("outage_s")
    return DirectionFigures(link["delay_ms"]["realised"]["p50"], link["loss_pct"], outage_s or None)


def requirements_section(run: RunView) -> Section:
    """Return the verdict on each set of requirements, with each requirement in numbers."""
    note = '<p class="note">p99: 99 of 100 are at or below it. Forward: to the patient; feedback: back.</p>'
    verdicts = verdict_tables(run.summary["verdicts"], run.summary["ticks"]["rate_hz"])
    return Section("requirements", "Requirements of applications", markup=note + verdicts if verdicts else "")


def accuracy_section(run: RunView) -> Section:
    """Return the estimators beside hold, and the redundancy of samples with its gain."""
    summary, active = run.summary, run.scenario.active_estimator
    by_hand = accuracy_by_hand(summary, run.scenario)
    accuracy = "".join(accuracy_table(scores, f"{hand} hand", active) for hand, scores in by_hand.items())
    turning = summary["active_orientation"]
    orientation = "".join(
        orientation_table(scores, summary["gripper_rad"][hand], f"{hand} hand", turning)
        for hand, scores in summary["orientation_deg"].items()
    )
    if orientation:
        orientation += (
            '<p class="note">Error of an orientation: the angle to the arm\'s true one. The answers carried that of '
            f"{escape(turning)}, marked above.</p>"
        )
    missing = '<p class="note">No estimate could be scored.</p>'
    markup = (
        "<p>Each estimator at the patient's ticks, beside <b>hold</b>, the baseline without estimating: it "
        "repeats the newest arm position that arrived.</p>"
        + (accuracy or missing)
        + f'<p class="note">The patient acted on {escape(active)}, marked above. RMSE in 3D: root mean square of the '
        "distance to the arm's true position. R\u00b2: the share of the movement that the "
        "estimates follow; 100 % is all of it.</p>"
        + orientation
        + more_accuracy(by_hand, active)
        + display_table(summary["display"])
        + tables.redundancy_table(summary["redundancy"])
    )
    return Section("accuracy", "The estimators compared", markup=markup, mark=run.mark)


def latency_section(run: RunView) -> Section:
    """Return the latency budget: the bar of means, and the percentiles of each part."""
    note = "The parts add up sample by sample, and so do their means; their medians and percentiles do not."
    if run.summary["mode"] == "twin":
        note += " In virtual time computing takes no time, so the surgeon's and the computing part are zero."
    bar = budget_bar(budget_ms(sample_latency(used_samples(run.logs, run.scenario.session, run.arms))))
    table = tables.latency_table(run.summary) + f'<p class="note">{note}</p>' + _age_of_information(run)
    markup = bar + tables.tick_mode_table(run.summary["tick_modes"]) + tables.folded("Each part in numbers", table)
    return Section("latency", "Latency", markup=markup)


def _definition(run: RunView) -> str:
    """Return the definition of the end-to-end latency, with a remark on topology observer."""
    observer = " Here, in topology observer, commands cross unimpaired, so it is mostly theirs."
    return f"{END_TO_END}.{observer if run.scenario.topology == 'observer' else ''}"


def _age_of_information(run: RunView) -> str:
    age = run.summary["age_of_information_ms"]
    if age["mean"] is None:
        return ""
    return (
        f'<p class="note">Age of information, how old the newest sample is at any instant: mean '
        f"{number(age['mean'])} ms; just before the next one comes (peak): mean {number(age['peak']['mean'])} ms.</p>"
    )
