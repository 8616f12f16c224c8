"""The orientation methods' errors in a terminal."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from deploy.report.tables.orientation_table import orientation_rows

_HEAD: Final = ("method", "RMS \u00b0", "% hold", "p95", "max", "in 95 %", "grip rad", "% hold")
_NOTE: Final = "\u00b0: angle to the true orientation; in 95 %: share within 1.96 stated deviations"


def orientation_views(summary: Mapping[str, Any]) -> list[RenderableType]:
    """Return a table that fits 80 columns for each hand with scored methods."""
    found = ((hand, list(orientation_rows(each, summary["gripper_rad"][hand]))) for hand, each in
             summary["orientation_deg"].items())  # fmt: skip
    return [_view(hand, rows) for hand, rows in found if rows]


def _view(hand: str, rows: Sequence[Sequence[str]]) -> RenderableType:
    title = f"\nOrientation and gripper at the tick ({hand} hand)"
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column(_HEAD[0], no_wrap=True)
    for name in _HEAD[1:]:
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(*row[:-1])
    return Group(table, Text(_NOTE, style="table.caption"))
