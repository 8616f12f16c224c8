"""The summary in a terminal: a brief of at most 20 lines where nothing is wrong, or all tables."""

import textwrap
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.text import Text

from tis.common.runtime.process import PACKAGES
from tis.deploy.present.numbers import number, percent
from tis.deploy.report.contents import run_warnings, tables
from tis.deploy.report.section import NOT_RESOLVABLE
from tis.deploy.report.subjects.network.link_figures import LinkVerdict
from tis.deploy.report.subjects.requirements import OUT_OF_REACH, SetVerdict, split_by_reach
from tis.deploy.report.subjects.sight_tables import sight_text
from tis.deploy.report.subjects.touch_tables import touch_text
from tis.deploy.report.summary import Summary
from tis.deploy.report.validity import validity_text
from tis.netem.control.replay import weightiest

FIDELITY_STYLES: Final = {True: "green", False: "red", None: "yellow"}
"""Terminal style of each value of a verdict's ``faithful``."""

MAX_LINES: Final = 15
"""Lines of the brief of a run without problems; the folder, the report and a hint at the tables follow it."""
MAX_FAULT_LINES: Final = 24
"""Lines of problems and warnings: what is wrong comes before brevity."""

_MANUAL: Final = "docs/testbed/troubleshooting.md"

_MAX_CHANGES: Final = 3
_NAME_WIDTH: Final = 14
_MS_PER_S: Final = 1000


class Row(NamedTuple):
    """A name, its text, and the text's style in a terminal."""

    name: str
    text: str
    style: str = ""


def brief(summary: Summary, warnings: Sequence[str], width: int, since: str | None = None) -> Text:
    """Return the brief, wrapped to ``width``; ``since`` as in `validity_text`. Oracle: test_brief.

    Without room for all warnings, or for very many problems, the first are shown and the others counted.
    """
    faults = _faults(summary, warnings)
    figures = [*_figures(summary), *_networks(summary), *_requirements(summary, only_counts=bool(faults))]
    shown, below = [*_wrapped(_head(summary, since), width)], [*_wrapped([*figures, *_read_on(summary)], width)]
    room = MAX_FAULT_LINES if summary.problems else MAX_LINES - len(shown) - len(below)
    return Text("\n").join([*shown, *_first(faults, room, width), *below])


def _head(summary: Summary, since: str | None) -> list[Row]:
    """Return the run, and whether it is valid."""
    style = "red" if since or not summary.valid else ""
    run = f"{summary.scenario} ({summary.mode}, {summary.source})"
    return [Row("", run, "bold"), Row("", validity_text(summary, since), style)]


def _faults(summary: Summary, warnings: Sequence[str]) -> list[Row]:
    problems = [Row("  ", text, "red") for text in summary.problems]
    return problems + [Row("  ", f"warning: {text}", "yellow") for text in warnings]


def _read_on(summary: Summary) -> Iterator[Row]:
    """Yield where the manual, which a wheel lacks, explains each problem."""
    if summary.problems:
        page = Path(PACKAGES) / _MANUAL
        near = page.relative_to(Path.cwd()) if page.is_relative_to(Path.cwd()) else page
        place = str(near) if page.is_file() else f"{_MANUAL} of the clone that tis was installed from"
        yield Row("", f"Each message in full: {place}")


def _figures(summary: Summary) -> Iterator[Row]:
    """Yield latency with its parts, loss, accuracy beside hold, and ticks."""
    median, most = (summary.text("latency_ms.end_to_end", name, " ms") for name in ("p50", "p99"))
    yield Row(
        "end to end", summary.unresolved_latency or f"median {median}, p99 {most}, from a new sample to its estimate"
    )
    parts = {"surgeon": "surgeon", "network": "network", "tick_wait": "tick wait", "compute": "computing"}
    found = {name: summary.text(f"latency_ms.{name}", "p50") for name in parts}
    if summary.mode == "twin":  # in virtual time computing takes none
        del parts["surgeon"], parts["compute"]
    texts = [f"{words} {'?' if found[name] == NOT_RESOLVABLE else found[name]}" for name, words in parts.items()]
    yield Row("medians, ms", ", ".join(texts))
    forward, back = (number(summary.links[way].loss_pct, " %") for way in ("forward", "feedback"))
    yield Row("packets lost", f"{forward} to the patient, {back} back")
    if samples := summary.redundancy.loss_text:
        yield Row("samples", f"sent {summary.redundancy}: {samples}")
    if summary.touch:
        yield Row("touch", touch_text(summary.touch))
    if summary.sight is not None:
        yield Row("sight", sight_text(summary.sight))
    yield from _accuracy(summary)
    yield from _orientation(summary)
    ticks, surgeon = summary.ticks, summary.surgeon_ticks
    counts = f"{number(ticks.count)} at {ticks.rate_hz} Hz, {number(ticks.missed)} missed"
    if entry := summary.accuracy.get("hold"):
        counts += f", {number(entry.n_scored)} scored"
    yield Row("ticks", f"{counts}; the surgeon missed {number(surgeon.missed)}")


def _accuracy(summary: Summary) -> Iterator[Row]:
    """Yield the active estimator's error beside hold's, and the other estimators' errors."""
    scores, active = summary.accuracy, summary.active_estimator
    entry, hold = scores.get(active), scores.get("hold")
    if entry is None or hold is None or hold.rmse_3d_mm is None:
        yield Row("error", "not known: no tick could be scored")
        return
    text = f"{entry.label(active)} {number(entry.rmse_3d_mm)} mm (RMSE in 3D)"
    if entry.without_answer:
        text = f"{active} failed: no estimate at any scored tick; hold {number(hold.rmse_3d_mm)} mm (RMSE in 3D)"
    elif active != "hold":
        share = "beside" if entry.ratio_to_hold is None else f"{percent(entry.ratio_to_hold)} % of"
        text += f", {share} the {number(hold.rmse_3d_mm)} mm of repeating the newest position (hold)"
    yield Row("error", text)
    others = [
        f"{one.label(name)} {number(one.rmse_3d_mm)}"
        for name, one in scores.items()
        if name not in (active, "hold", "plant")
    ]
    if others:
        yield Row("others, mm", ", ".join(others))
    by_hand = summary.accuracy_by_hand
    errors = [f"{hand} {number(one[active].rmse_3d_mm)}" for hand, one in by_hand.items() if active in one]
    if errors:
        yield Row("by hand, mm", ", ".join(errors))
    yield from _arm(summary)


def _arm(summary: Summary) -> Iterator[Row]:
    """Yield the error of an arm that executes the set points, and how late it follows them."""
    entry = summary.accuracy.get("plant")
    if entry is None or entry.rmse_3d_mm is None or entry.n_missing == entry.n_scored:
        return
    text = f"{number(entry.rmse_3d_mm)} mm (RMSE in 3D)"
    lag_ms = summary.latency_ms.actuation["p50"]
    if lag_ms is not None:
        text += f"; it follows the estimate {number(lag_ms)} ms later (median)"
    if entry.clamped_pct:
        text += f"; {number(entry.clamped_pct)} % of the set points were out of its reach"
    yield Row("arm", text)


def _orientation(summary: Summary) -> Iterator[Row]:
    """Yield the active orientation method's error beside hold's; of two hands each has its own."""
    active, texts = summary.active_orientation, []
    for hand, scores in summary.orientation_deg.items():
        entry = scores.get(active)
        if entry is None or entry["rms"] is None:
            continue
        share = "" if entry.ratio_to_hold is None else f" ({percent(entry.ratio_to_hold)} % of hold's)"
        which = f"{hand} " if len(summary.orientation_deg) > 1 else ""
        texts.append(f"{which}{number(entry['rms'])} deg{share if active != 'hold' else ''}")
    if texts:
        yield Row("orientation", f"{active} {', '.join(texts)}")


def _networks(summary: Summary) -> Iterator[Row]:
    """Yield whether the network was the requested one, and why not: one row when both directions say the same."""
    verdicts = {way: link.verdict for way, link in summary.links.items()}
    texts = {way: verdict.text("the scenario") + _reason(verdict) for way, verdict in verdicts.items()}
    for text in dict.fromkeys(texts.values()):
        ways = [way for way, one in texts.items() if one == text]
        name = "network" if len(ways) == len(texts) else ways[0]
        yield Row(name, text, FIDELITY_STYLES[verdicts[ways[0]].faithful])
    if changes := summary.changes:
        shown, more = weightiest(changes, _MAX_CHANGES), len(changes) - _MAX_CHANGES
        texts_of = "; ".join([*shown, *([f"and {more} more"] if more > 0 else [])])
        times = "once" if len(changes) == 1 else f"{len(changes)} times"
        yield Row("changed", f"{times} while it ran, which all figures include: {texts_of}", "yellow")


def _reason(verdict: LinkVerdict) -> str:
    if verdict.faithful is not False or not verdict.violations:
        return ""
    first, *others = verdict.violations
    return f": {first}" + (f"; {len(others)} more: tis info -v" if others else "")


OUTCOME_STYLES: Final = {"missed": "red", "not decidable": "yellow", "met": "green", OUT_OF_REACH: ""}
"""Terminal style of each outcome of a set of requirements, in words."""


def _requirements(summary: Summary, only_counts: bool) -> Iterator[Row]:
    """Yield the sets of requirements by outcome, or their numbers: what is wrong needs the room of their names.

    Those out of reach at the run's rate are named apart.
    """
    rate_hz = summary.ticks.rate_hz
    near, far = split_by_reach(summary.verdicts, rate_hz)
    titles: dict[str, list[str]] = {outcome: [] for outcome in OUTCOME_STYLES}
    for verdict in near:
        titles[verdict.outcome_text(rate_hz)].append(verdict.title)
    if only_counts:
        counts = [f"{len(titles[one])} {one}" for one in ("met", "missed", "not decidable") if titles[one]]
        counts += [f"{len(summary.verdicts) - len(near)} {OUT_OF_REACH}"] if far else []
        yield Row("requirements", f"at {rate_hz} Hz: {', '.join(counts)}")
        return
    for outcome, style in OUTCOME_STYLES.items():
        if titles[outcome]:
            yield Row(outcome, ", ".join(titles[outcome]), style)
    if far:
        yield Row(OUT_OF_REACH, far)


def _wrapped(rows: Sequence[Row], width: int) -> Iterator[Text]:
    for row in rows:
        name = f"  {row.name:<{_NAME_WIDTH}}" if row.name.strip() else row.name
        further = " " * (len(name) if row.name.strip() else len(name) + 2)
        for line in textwrap.wrap(row.text, width, initial_indent=name, subsequent_indent=further):
            yield Text(line, style=row.style)


def _first(rows: Sequence[Row], room: int, width: int) -> list[Text]:
    """Return the rows that fit ``room`` lines, at least the first, whole; the others are counted in a last line."""
    each = [[*_wrapped([row], width)] for row in rows]
    if sum(map(len, each)) <= room:
        return [line for lines in each for line in lines]
    shown: list[Text] = []
    n_shown = 0
    for lines in each:
        if n_shown and len(shown) + len(lines) > room - 1:
            break
        shown += lines
        n_shown += 1
    left = len(rows) - n_shown
    return [*shown, Text(f"  and {left} more: tis info -v shows all", style=rows[-1].style)] if left else shown


_HANG: Final = 2


@dataclass(frozen=True)
class HangingIndent:
    """Text indented by ``indent`` columns, and two more after the first line. Oracle: test_hanging_indent."""

    text: str
    style: str = ""
    indent: int = 2

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the lines, wrapped to the console's width."""
        further = self.indent + _HANG
        lines = Text(self.text, style=self.style).wrap(console, max(1, options.max_width - further))
        for i, line in enumerate(lines):
            yield Text(" " * (further if i else self.indent)) + line


_MAX_SENTENCES: Final = 6


def print_summary(
    summary: Summary,
    console: Console,
    since: str | None = None,
    verbose: bool = False,
    told: Collection[str] = (),
) -> None:
    """Print the brief, or all tables if ``verbose``; ``since`` names damage to the logs after it was written.

    Warnings that were ``told`` before are left out.
    """
    warnings, width = [text for text in run_warnings(summary) if text not in told], console.width
    if verbose:
        console.print(_in_full(summary, warnings, width, since))
    else:
        console.print(brief(summary, warnings, width, since), soft_wrap=True)


def _in_full(summary: Summary, warnings: Sequence[str], width: int, since: str | None) -> RenderableType:
    """Return the rows of the brief, all faults among them, and more; then each verdict and all tables."""
    faults = [*_faults(summary, warnings), *_read_on(summary)]
    rows = [*_head(summary, since), *faults, *_figures(summary), *_details(summary)]
    parts: list[RenderableType] = [*_wrapped(rows, width)]
    parts += [verdict_view(f"network {d}", link.verdict, "the scenario") for d, link in summary.links.items()]
    parts += [table.terminal() for table in tables(summary)]
    parts += [Text(f"\n{summary.tick_modes.line}")]
    parts.append(Text("\nRequirements of applications:", style="bold"))
    parts += [_verdict_line(verdict, summary.ticks.rate_hz) for verdict in summary.verdicts]
    return Group(*parts)


def verdict_view(name: str, verdict: LinkVerdict, request: str, shown: Sequence[str] = ()) -> Group:
    """Return the fidelity of a direction, with violations and warnings, without any with ``shown``."""
    style = FIDELITY_STYLES[verdict.faithful]
    found = [*verdict.violations, *(f"warning: {warning}" for warning in verdict.warnings)] or [*shown]
    lines = found[:_MAX_SENTENCES]
    if len(found) > _MAX_SENTENCES:
        lines.append(f"and {len(found) - _MAX_SENTENCES} more, see summary.json")
    head = HangingIndent(f"{name}: {verdict.text(request)}", style)
    return Group(head, *(HangingIndent(sentence, style, indent=4) for sentence in lines))


def _details(summary: Summary) -> Iterator[Row]:
    """Yield what the brief has no room for: age and lateness at the ticks, what was sent, and the model."""
    yield Row("age", f"the newest sample was at most {summary.text('age_ms', 'max', ' ms')} old at a tick")
    late = summary.ticks.lateness_us
    if late["p99"]:
        yield Row("ticks late", f"begun late by median {number(late['p50'])}, p99 {number(late['p99'])} \u00b5s")
    if rate := summary.redundancy.rate_text:
        yield Row("sent", f"by the surgeon: {rate}")
    if summary.identification:
        yield Row("model", str(summary.identification))


def _verdict_line(verdict: SetVerdict, rate_hz: int) -> HangingIndent:
    outcome = verdict.outcome_text(rate_hz)
    at_rate = f"{OUT_OF_REACH} at {rate_hz} Hz" if outcome == OUT_OF_REACH else outcome
    return HangingIndent(verdict.line.replace(verdict.outcome.replace("_", " "), at_rate, 1), OUTCOME_STYLES[outcome])
