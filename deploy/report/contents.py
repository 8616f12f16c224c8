"""Contents of a report, subject by subject: its warnings, the tables of a terminal, and the sections of the page."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from html import escape
from typing import Final, Literal

from tis.common.channels import Direction
from tis.common.runtime.process import repeatable
from tis.deploy.present.numbers import NONE, number
from tis.deploy.present.page import Page, Section, folded, nonbreaking_units, note, page_html, part
from tis.deploy.present.table import Column, Table
from tis.deploy.report.answer import answer_section
from tis.deploy.report.run_view import RunView
from tis.deploy.report.subjects import (
    accuracy,
    age,
    audit,
    clocks,
    devices,
    display,
    identification,
    intrusion,
    latency,
    logs,
    orientation,
    own_estimators,
    processors,
    redundancy,
    requirement_tables,
    safety,
    seen_strip,
    sight,
    sight_tables,
    stretches,
    ticks,
    touch_tables,
)
from tis.deploy.report.subjects.network import link_tables
from tis.deploy.report.subjects.network.link_figures import Link
from tis.deploy.report.summary import Summary
from tis.deploy.shell.run_dir import MANIFEST_FILE, SCENARIO_FILE, SUMMARY_FILE, model_file

WARNINGS: Final[tuple[Callable[[Summary], Sequence[str]], ...]] = (
    lambda s: intrusion.evidence_texts(s.evidence),
    lambda s: logs.absence_texts(s.logs),
    lambda s: intrusion.quarantine_texts(s.quarantined),
    lambda s: safety.stop_texts(s.safety),
    lambda s: safety.limit_texts(
        s.safety, [hand for hand, found in s.touch.items() if found.stability == "unstable"]
    ),
    lambda s: devices.device_texts(s.devices, s.external_arms),
    lambda s: devices.camera_texts(s.external_camera),
    lambda s: sight_tables.sight_texts(s.sight),
    lambda s: intrusion.refusal_texts(s.refused),
    lambda s: own_estimators.estimator_fault_texts(
        {
            name: own
            for name, own in s.own_estimators.items()
            if not (name in s.accuracy and s.accuracy[name].without_answer)
        }
    ),
    lambda s: accuracy.silent_texts(s.accuracy, s.active_estimator, s.own_estimators),
    lambda s: s.in_sample or (),
    lambda s: s.recording.warnings if s.recording else (),
)


def run_warnings(summary: Summary) -> list[str]:
    """Return the warnings on a run's figures: sides, devices, estimators, models, the recording's."""
    return [text for warnings in WARNINGS for text in warnings(summary)]


def tables(summary: Summary) -> list[Table]:
    """Return the tables of a terminal, each 80 columns wide at most."""
    found = [
        *_accuracy_tables(summary),
        *_orientation_tables(summary),
        *display.display_tables(summary.display),
        *touch_tables.touch_tables(summary.touch),
        *sight_tables.sight_tables(summary.sight, summary.uncertainty_ms.get(sight.GLASS, {})),
        *stretches.stretch_tables(summary.stretches),
        redundancy.redundancy_table(summary.redundancy),
        link_tables.packet_table(summary.links),
        link_tables.delay_table(summary.links),
        latency.latency_table(summary.latency_ms, summary.uncertainty_ms),
    ]
    return [table for table in found if table.rows]


def _accuracy_tables(summary: Summary) -> list[Table]:
    by_hand, active = summary.scores_by_hand, summary.active_estimator
    return [accuracy.accuracy_table(one, f"{hand} hand", active) for hand, one in by_hand.items()]


def _orientation_tables(summary: Summary) -> list[Table]:
    active, gripper = summary.active_orientation, summary.gripper_rad
    return [
        orientation.orientation_table(one, gripper[hand], f"{hand} hand", active)
        for hand, one in summary.orientation_deg.items()
    ]


def sections(run: RunView) -> list[Section]:
    """Return the sections of a run's page in reading order, the answer first."""
    from tis.deploy.report.plots.page_plots import page_figures  # loads Bokeh

    summary, links = run.summary, run.summary.links
    drawn = page_figures(run)
    turns = any(bins.n for of_hand in summary.orientation_by_age.values() for bins in of_hand.values())
    bounds = summary.uncertainty_ms.get(sight.GLASS, {})
    seen_tables, seen_text = sight_tables.sight_markup(summary.sight, bounds)
    strip = seen_strip.strip_markup(run.measured.logs.run_dir, run.scenario, run.measured.pictures)
    found = [
        answer_section(run, run_warnings(summary)),
        Section("stretches", "Each network of the run", markup=_stretches(run), mark=run.mark),
        Section("touch", "Touch", drawn["touch"], _touch_figures(summary), _touch(summary), run.mark),
        Section("sight", "Sight", drawn["sight"], seen_tables, seen_text + strip, run.mark),
        Section("error", "Error", drawn["error"], mark=run.mark, beside=True),
        Section("requirements", "Requirements of applications", markup=_requirements(summary)),
        Section("accuracy", "The estimators compared", markup=_accuracy(run), mark=run.mark),
        Section("path", "The arm's movement", drawn["path"], mark=run.mark, more="Position over time"),
        Section("safety", "What drove the arm", drawn["safety"], mark=run.mark),
        Section("latency", "Latency", markup=_latency(run)),
        Section(
            "model",
            "Identification",
            drawn["model"],
            before=_models(run),
            mark=run.mark,
            beside=True,
            more="Singular values and poles",
        ),
        Section("delay", "Delay and loss", drawn["delay"]),
        Section(
            "distributions",
            "Distributions, and what age costs",
            drawn["distributions"],
            mark=run.mark,
            beside=True,
            more="Delays, losses in a row, release errors" + ", orientation against age" * turns,
        ),
        Section("network", "Requested and realised network", markup=_network(links) + _books(summary)),
        Section("clocks", "Clocks", drawn["clocks"], before=_filled(clocks.clock_table(summary.clocks))),
        Section("audit", "Who connected, and who was refused", markup=audit.audit_markup(run.logs)),
        Section("repeat", "Repeat this run", markup=_repeat(run)),
    ]
    # most runs have nothing to say there; the sections of others say that it lacks
    spare = ("stretches", "touch", "sight", "safety", "clocks", "audit")
    return _in_columns(
        [one for one in found if one.anchor not in spare or one.before or one.markup or any(one.figures)]
    )


_SHORT: Final = ("safety", "latency", "model")
"""Sections that stand on the right of the path, which is high."""


def _in_columns(found: Sequence[Section]) -> list[Section]:
    """Return the sections, with those marked that stand side by side: else the page is long.

    The audit log is below the others on the right of the path where nothing drove an arm, else it is beside the last.
    """
    of = {one.anchor: one for one in found}
    columns: dict[str, Literal["left", "right"]] = {"path": "left", **dict.fromkeys(_SHORT, "right")}
    order = [one.anchor for one in found]
    if "audit" in of and "safety" in of:
        columns |= {"audit": "left", "repeat": "right"}
    elif "audit" in of:
        columns["audit"] = "right"
        order.remove("audit")
        order.insert(order.index(_SHORT[-1]) + 1, "audit")
    return [replace(of[anchor], column=columns.get(anchor, "")) for anchor in order]


def _requirements(summary: Summary) -> str:
    """Return the verdict on each set of requirements, with each requirement in numbers."""
    lead = note("p99: 99 of 100 are at or below it. Forward: to the patient; feedback: back.")
    found = requirement_tables.verdict_tables(summary.verdicts, summary.ticks.rate_hz)
    return folded("Each verdict, and why", lead + found) if found else ""


def _stretches(run: RunView) -> str:
    """Return the arm in each network of the run, and the runs at targets."""
    tables = stretches.stretch_tables(run.summary.stretches)
    each = zip(run.summary.stretches, tables, strict=True)
    targets = stretches.target_table(run.logs)
    played = folded(f"Runs at targets: {len(targets.rows)}", targets.html()) if targets.rows else ""
    return "".join(part(hand, _filled(table)) for hand, table in each) + played


def _touch(summary: Summary) -> str:
    """Return whether the loop of each hand was stable, as a paragraph."""
    return "".join(
        part(hand, f'<p class="answer">{escape(nonbreaking_units(touch_tables.answer_text(found)))}</p>')
        for hand, found in summary.touch.items()
    )


def _touch_figures(summary: Summary) -> str:
    tables = zip(summary.touch, touch_tables.touch_tables(summary.touch), strict=True)
    markup = "".join(part(hand, table.html()) for hand, table in tables)
    return folded("Each figure of touch", markup) if markup else ""


def _accuracy(run: RunView) -> str:
    """Return the estimators beside hold, the orientation, the display, and the gain of redundancy."""
    summary, active = run.summary, run.scenario.active_estimator
    scored, turned, shown = (
        "".join(part(hand, _filled(table)) for hand, table in tables)
        for tables in (
            zip(summary.scores_by_hand, _accuracy_tables(summary), strict=True),
            zip(summary.orientation_deg, _orientation_tables(summary), strict=True),
            (("", table) for table in display.display_tables(summary.display)),
        )
    )
    if turned:
        turned += note(f"The answers carried the orientation of {summary.active_orientation}, marked above.")
    return (
        "<p>Each estimator at the patient's ticks, beside <b>hold</b>, the baseline without estimating: it "
        "repeats the newest arm position that arrived.</p>"
        + (scored or note("No estimate could be scored."))
        + note(
            f"The patient acted on {active}, marked above. RMSE in 3D: root mean square of the distance to the arm's "
            "true position. R\u00b2: the share of the movement that the estimates follow; 100 % is all of it."
            + " plant: the arm itself, which executes the set points."
            * ("plant" in summary.accuracy)
        )
        + turned
        + accuracy.more_accuracy(summary.scores_by_hand, active)
        + folded("What the surgeon sees: delayed feedback and predicted arm", shown)
        + _filled(redundancy.redundancy_table(summary.redundancy))
    )


def _filled(table: Table) -> str:
    """Return a table for the page, "" without rows."""
    return table.html() if table.rows else ""


def _latency(run: RunView) -> str:
    """Return the latency budget: the bar of means, and the percentiles of each part."""
    summary = run.summary
    text = "The parts add up sample by sample, and so do their means; their medians and percentiles do not."
    if summary.mode == "twin":
        text += " In virtual time computing takes no time, so the surgeon's and the computing part are zero."
    parts = latency.latency_page_table(summary.latency_ms, summary.uncertainty_ms).html() + note(text)
    parts += note(age.age_text(summary.age_of_information_ms))
    bar = latency.budget_bar(latency.budget_ms(run.measured.latency))
    if not (clock := clocks.clock_table(summary.clocks)).rows:
        parts += note(clock.note)
    parts += age.tick_mode_table(summary.tick_modes).html()
    return bar + folded("Each part in numbers, and what another mode of the tick would save", parts)


def _models(run: RunView) -> str:
    models = run.models
    warnings = dict.fromkeys(text for model in models.values() for text in model.warnings)
    words = "".join(f'<p><strong class="open">warning</strong> {escape(text)}</p>' for text in warnings)
    table = identification.model_table(models)
    return words + (folded("The model in numbers", table.html()) if table.rows else note(table.note))


def _network(links: Mapping[Direction, Link]) -> str:
    """Return whether the realised network was the requested one, and both in numbers, of directions and keys."""
    in_numbers = link_tables.delay_table(links).html()
    return (
        link_tables.fidelity_list(links)
        + folded("Delay and loss, requested, decided and realised", in_numbers)
        + link_tables.key_tables(links)
    )


def _books(summary: Summary) -> str:
    """Return the tables of packets and ticks, with definitions of their terms."""
    rate = summary.redundancy.rate_text
    rejected = ", ".join(f"{side} {number(count)}" for side, count in summary.rejected.items()) or NONE
    lateness = ticks.tick_table({"patient": summary.ticks, "surgeon": summary.surgeon_ticks}).html()
    text = (
        link_tables.packet_table(summary.links).html()
        + note(f"The surgeon sent {rate} (payload and attachment)." if rate else "")
        + (lateness if summary.mode != "twin" else note("In virtual time every tick begins at its instant."))
        + note(
            "A tick that has not begun when the next one is due is missed. Samples that arrived but were never the "
            f"freshest: {number(summary.superseded)}. Messages rejected: {rejected}."
        )
        + _filled(processors.processor_table(summary.processors))
    )
    return folded("Each count of packets and ticks", text)


def _repeat(run: RunView) -> str:
    files = (
        (SCENARIO_FILE, "has every value of the scenario, defaults too"),
        (model_file(run.logs.run_dir).name, "the identified models"),
        (SUMMARY_FILE, "every figure"),
        (MANIFEST_FILE, "the hashes of all files"),
    )
    listed = ", ".join(f'<a href="{name}">{name}</a> {what}' for name, what in files)
    again = (
        "and the resolved scenario in its folder, which gives every message the same fate again, live or in virtual "
        "time",
        "tis run scenario.yaml\ntis twin scenario.yaml",
    )
    if run.scenario.source.kind == "live":  # nobody moves the same way twice
        again = ("and the one that computes its estimates again from what arrived, in its folder", "tis replay .")
    return (
        f"<p>The command of this run, {again[0]}:</p>"
        f"<pre><code>{escape(repeatable(run.summary.command) or NONE)}\n{again[1]}</code></pre>"
        f"<p>The seed {run.summary.seed} determines every random number of the run. In its folder, "
        f"beside this page: {listed}.</p>" + folded("Versions", versions_table(run.versions).html())
    )


def versions_table(versions: Mapping[str, str | None]) -> Table:
    """Return the versions of the packages that a run used."""
    rows = [(name, version or "not installed") for name, version in versions.items()]
    return Table("Versions", ("package", Column("version", words=True)), rows)


_LEAD: Final = (
    "One run of the testbed: a surgeon's hand moves a master, an emulated network delays and loses its samples, and "
    "the patient's side estimates where the robot arm should be now. How late, how lossy and how accurate was that?"
)


def report_html(run: RunView) -> str:
    """Return the page of a run; it names what its logs lack."""
    name = run.scenario.name
    title = f"{name}: report of a run{' (synthetic)' if run.synthetic else ''}"
    hands = [(hand, f"{hand} hand") for hand in run.hands]
    return page_html(Page(title, name, _tags(run), sections(run), _LEAD, hands))


def _tags(run: RunView) -> list[tuple[str, str]]:
    """Return the marks below the title: validity, origin and mode of the run."""
    summary = run.summary
    kinds = {"live": "live: real processes, real time", "twin": "twin: virtual time"}
    tags = [("valid measurement", "good") if summary.valid else ("not a valid measurement", "bad")]
    if run.synthetic:
        tags.append(("synthetic movement, not a recording of a person", "open"))
    tags += [(summary.source, ""), (kinds.get(summary.mode, summary.mode), "")]
    return [*tags, (f"seed {summary.seed}", ""), (f"{summary.duration_s:.4g} s", "")]
