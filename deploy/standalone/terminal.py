"""Terminal view of a standalone netem's summary."""

from typing import Any, Final

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from deploy.report.tables.hanging_indent import HangingIndent
from deploy.report.tables.numbers import number
from deploy.report.tables.terminal import delays_view, drop_reasons
from deploy.report.verdict.verdict_text import FIDELITY_STYLES, fidelity_text
from netem.expected.synopsis import direction_label

_MAX_SENTENCES: Final = 6
_COUNTS: Final = ("offered", "copied", "released", "dropped", "held_at_end")


def summary_view(summary: dict[str, Any]) -> RenderableType:
    """Return the verdicts, then the packets and the delays of both directions."""
    links = summary["links"]
    parts: list[RenderableType] = [Text(_headline(summary), style="bold")]
    parts += [HangingIndent(f"not valid: {text}", "red") for text in summary["problems"]]
    parts += [_verdict(direction, link["verdict"]) for direction, link in links.items()]
    return Group(*parts, _packets(links), delays_view(links, "by the options"))


def _headline(summary: dict[str, Any]) -> str:
    profile = "" if summary["profile"] is None else f", profile {summary['profile']}"
    begun = "" if summary["begun"] is None else f", begun {summary['begun']}"
    keys = ", ".join(summary["keys"])
    return f"netem between two networks for {summary['duration_s']:.1f} s: {keys}{profile}{begun}"


def _verdict(direction: Any, verdict: dict[str, Any]) -> Group:
    words, style = fidelity_text(verdict, "the request"), FIDELITY_STYLES[verdict["faithful"]]
    shown = [*verdict["violations"], *(f"warning: {warning}" for warning in verdict["warnings"])]
    shown = shown or verdict["not_decidable"]
    lines = shown[:_MAX_SENTENCES]
    if len(shown) > _MAX_SENTENCES:
        lines.append(f"and {len(shown) - _MAX_SENTENCES} more, see summary.json")
    return Group(
        HangingIndent(f"{direction_label(direction)}: {words}", style),
        *(HangingIndent(sentence, style, indent=4) for sentence in lines),
    )


def _table(title: str, columns: tuple[str, ...]) -> Table:
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("", no_wrap=True)
    for name in columns:
        table.add_column(name, justify="right", no_wrap=True)
    return table


def _with_note(table: Table, note: str) -> RenderableType:
    """Return a table with a note below it, as wide as the console."""
    return Group(table, Text(note, style="table.caption"))


def _packets(links: dict[str, Any]) -> RenderableType:
    names = ("offered", "copied", "released", "dropped", "held", "lost %", "mean run")
    table = _table("Messages", names)
    for direction, link in links.items():
        shares = (link["loss_pct"], link["loss_runs"]["mean"])
        table.add_row(direction, *(number(link[name]) for name in _COUNTS), *(number(share) for share in shares))
    note = f"dropped: by netem{drop_reasons(links)}; held: still under way at the end; mean run: of losses in a row. "
    return _with_note(table, f"{note}netem's log does not cover what happened before and behind it")
