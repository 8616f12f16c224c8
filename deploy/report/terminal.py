"""The summary in a terminal: the brief, or all tables."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.text import Text

from tis.deploy.present.numbers import number
from tis.deploy.report.brief import FIDELITY_STYLES, brief
from tis.deploy.report.contents import run_warnings, tables
from tis.deploy.report.subjects.network.link_figures import LinkVerdict
from tis.deploy.report.subjects.requirements import OUT_OF_REACH, SetVerdict
from tis.deploy.report.subjects.ticks import tick_line
from tis.deploy.report.summary import Summary
from tis.deploy.report.validity import validity_text

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


def print_summary(summary: Summary, console: Console, since: str | None = None, verbose: bool = False) -> None:
    """Print the brief, or all tables if ``verbose``; ``since`` names damage to the logs after it was written."""
    if verbose:
        console.print(summary_view(summary, since))
    else:
        console.print(brief(summary, run_warnings(summary), console.width, since), soft_wrap=True)


def summary_view(summary: Summary, since: str | None = None) -> RenderableType:
    """Return the summary as text and tables, the result first; ``since`` as in `validity_text`."""
    parts: list[RenderableType] = [Text(_headline(summary), style="bold")]
    parts.append(Text(validity_text(summary, since), style="red" if since or not summary.valid else ""))
    parts += [HangingIndent(f"not valid: {text}", "red") for text in summary.problems]
    parts += [HangingIndent(f"warning: {text}", "yellow") for text in run_warnings(summary)]
    parts += [verdict_view(f"network {d}", link.verdict, "the scenario") for d, link in summary.links.items()]
    parts += [table.terminal() for table in tables(summary)]
    parts += [Text(f"\n{_footer(summary)}"), Text(summary.tick_modes.line)]
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


def _headline(summary: Summary) -> str:
    """Return latency, loss and accuracy, a line each."""
    median, p99 = (summary.text("latency_ms.end_to_end", name, " ms") for name in ("p50", "p99"))
    lost = number(summary.links["forward"].loss_pct, " %")
    oldest = summary.text("age_ms", "max", " ms")
    latency = (
        f"end to end, sample to estimate: median {median}, p99 {p99}.\n"
        f"At the ticks the newest sample was at most {oldest} old"
    )
    text = (
        f"{summary.scenario} ({summary.mode}, {summary.source}):\n{summary.unresolved_latency or latency}."
        f"\n{lost} of the packets to the patient were lost."
    )
    if samples := summary.redundancy.loss_text:
        text += f"\nThe surgeon sent {summary.redundancy}: {samples}."
    name = summary.active_estimator
    entry = summary.accuracy.get(name)
    if entry is not None and entry.ratio_to_hold is not None:
        text += f"\n{name} errs by {number(entry.rmse_3d_mm, ' mm')} (RMSE in 3D), "
        text += f"{100 * entry.ratio_to_hold:.0f} % of the error of repeating the newest position (hold)."
    return text


def _verdict_line(verdict: SetVerdict, rate_hz: int) -> HangingIndent:
    outcome = verdict.outcome_text(rate_hz)
    style = {"met": "green", "missed": "red", "not decidable": "yellow", OUT_OF_REACH: ""}[outcome]
    at_rate = f"{OUT_OF_REACH} at {rate_hz} Hz" if outcome == OUT_OF_REACH else outcome
    return HangingIndent(verdict.line.replace(verdict.outcome.replace("_", " "), at_rate, 1), style)


def _footer(summary: Summary) -> str:
    line = tick_line(summary.ticks, summary.surgeon_ticks)
    if rate := summary.redundancy.rate_text:
        line += f". Sent by the surgeon: {rate}"
    return line + (f". Model: {summary.identification}." if summary.identification else "")
