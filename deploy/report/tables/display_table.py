"""Table of the surgeon's display: errors of the delayed feedback and of the predicted arm, in page and terminal."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from tis.deploy.report.tables.html_tables import folded, table
from tis.deploy.report.tables.numbers import number

_SHOWN: Final = {"feedback_mm": "delayed feedback", "predicted_mm": "predicted arm"}
_HEAD: Final = (
    "shown to the surgeon", "RMS at effect, mm", "median", "p95", "max", "RMS now, mm",
)  # fmt: skip
_NOTE: Final = (
    "At effect: distance to where the arm is at the patient's first tick that has the command given at that moment. "
    "Now: to where it is at that moment"
)


def display_rows(found: Mapping[str, Any]) -> Iterator[Sequence[str]]:
    """Yield a row for the feedback, and one for the prediction, of a hand's entry in the summary's ``display``."""
    for name, title in _SHOWN.items():
        at_effect, now = found[name]["at_effect"], found[name]["now"]
        figures = (*(at_effect[statistic] for statistic in ("rms", "p50", "p95", "max")), now["rms"])
        yield (title, *(number(value) for value in figures))


def display_table(display: Mapping[str, Any]) -> str:
    """Return the tables of all hands for the report, folded; "" without a display."""
    tables = "".join(
        table(f"The surgeon's display, {hand} hand", _HEAD, list(display_rows(found)))
        for hand, found in display.items()
        if _is_scored(found)
    )
    note = f'<p class="note">{_NOTE}. The prediction adds to the feedback what was commanded since.</p>'
    return folded("What the surgeon sees: delayed feedback and predicted arm", tables + note) if tables else ""


def display_views(display: Mapping[str, Any]) -> list[RenderableType]:
    """Return a table that fits 80 columns for each hand with a display."""
    return [_view(hand, found) for hand, found in display.items() if _is_scored(found)]


def _is_scored(found: Mapping[str, Any] | None) -> bool:
    return found is not None and found["n"] > 0


def _view(hand: str, found: Mapping[str, Any]) -> RenderableType:
    title = f"\nDisplay of the surgeon, mm ({hand} hand)"
    view = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    view.add_column("shown", no_wrap=True)
    for name in ("RMS at effect", "median", "p95", "max", "RMS now"):
        view.add_column(name, justify="right", no_wrap=True)
    for row in display_rows(found):
        view.add_row(*row)
    note = f"{_NOTE}. Seen late by {number(found['late_ms']['p50'])} ms (median)"
    return Group(view, Text(note, style="table.caption"))
