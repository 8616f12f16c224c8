"""The summary of a standalone netem as one reads it in a terminal."""

from typing import Any, Final

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from deploy.report.tables.statistic_names import heads
from deploy.report.tables.terminal import number
from deploy.report.verdict.faithful import STYLES, faith_in_words
from netem.synopsis import way

_MOST_SENTENCES: Final = 6
_COUNTS: Final = ("offered", "copied", "released", "dropped", "held_at_end")
_STATISTICS: Final = ("mean", "std", "p50", "p99", "max")


def summary_view(summary: dict[str, Any]) -> RenderableType:
    """Return the answer first, then the packets and the delays of both directions."""
    links = summary["links"]
    parts: list[RenderableType] = [Text(_headline(summary), style="bold")]
    parts += [Text(f"  not valid: {text}", style="red") for text in summary["problems"]]
    parts += [_verdict(direction, link["verdict"]) for direction, link in links.items()]
    return Group(*parts, _packets(links), _delays(links))


def _headline(summary: dict[str, Any]) -> str:
    profile = "" if summary["profile"] is None else f", profile {summary['profile']}"
    begun = "" if summary["begun"] is None else f", begun {summary['begun']}"
    keys = ", ".join(summary["keys"])
    return f"netem between two networks for {summary['duration_s']:.1f} s: {keys}{profile}{begun}"


def _verdict(direction: Any, verdict: dict[str, Any]) -> Text:
    words, style = faith_in_words(verdict, "what was asked"), STYLES[verdict["faithful"]]
    text = Text(f"  {way(direction)}: {words}", style=style)
    shown = [*verdict["violations"], *(f"warning: {warning}" for warning in verdict["warnings"])]
    shown = shown or verdict["not_decidable"]
    for sentence in shown[:_MOST_SENTENCES]:
        text.append(f"\n    {sentence}")
    if len(shown) > _MOST_SENTENCES:
        text.append(f"\n    and {len(shown) - _MOST_SENTENCES} more, see summary.json")
    return text


def _table(title: str, caption: str, columns: tuple[str, ...]) -> Table:
    table = Table(title=title, caption=caption, box=box.SIMPLE_HEAD, pad_edge=False)
    table.title_justify = table.caption_justify = "left"
    table.add_column("", no_wrap=True)
    for name in columns:
        table.add_column(name, justify="right", no_wrap=True)
    return table


def _packets(links: dict[str, Any]) -> Table:
    caption = "dropped: by netem, as asked; held: still under way at the end;\n"
    caption += "mean run: of losses in a row. netem's log tells nothing of what\n"
    caption += "happened before and behind it"
    names = ("offered", "copied", "released", "dropped", "held", "lost %", "mean run")
    table = _table("Messages", caption, names)
    for direction, link in links.items():
        shares = (link["loss_pct"], link["loss_runs"]["mean"])
        table.add_row(direction, *(number(link[name]) for name in _COUNTS), *(number(share) for share in shares))
    return table


def _delays(links: dict[str, Any]) -> Table:
    caption = "requested: what was asked for; decided: drawn by its models;\n"
    caption += "realised: measured in netem; release error: left later by"
    table = _table("Delay in netem, one way", caption, heads(_STATISTICS))
    for direction, link in links.items():
        for kind, delay in link["delay_ms"].items():
            table.add_row(f"{direction} {kind}, ms", *(number(delay[name]) for name in _STATISTICS))
        error = link["release_error_us"]
        tail = (number(error[name]) for name in ("p50", "p99", "max"))
        table.add_row(f"{direction} release error, \u00b5s", "", "", *tail)
    return table
