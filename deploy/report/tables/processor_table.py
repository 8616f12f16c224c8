"""Table of processor shares by side."""

from collections.abc import Mapping
from typing import Any, Final

from tis.deploy.report.tables.html_tables import table
from tis.deploy.report.tables.numbers import number

_SHARES: Final = {
    "testbed_pct": "tis",
    "others_pct": "other programs",
    "steal_pct": "taken by VM's host",
    "idle_pct": "idle",
    "iowait_pct": "disk wait",
    "own_pct": "this side, of one",
}
_NOTE: Final = (
    "Shares of the time of all processors that a side may use, over the whole run; short bursts hardly show. tis: "
    "its sides on this host. Other programs: all else, the live page too. Taken by a virtual machine's host: steal "
    "time, while a process wanted to run. This side: of one processor's time, above 100 with several threads. "
    "-: unknown, which is not 0."
)
_QUOTA_NOTE: Final = (
    " Quota: the processor time that the side's control group may use, in processors. Held back: the share of its "
    "periods in which the group was throttled."
)


def processor_table(processors: Mapping[str, Mapping[str, Any] | None]) -> str:
    """Return a row for each side of the summary's ``processors``; "" without any notes."""
    noted = {side: entry for side, entry in processors.items() if entry is not None}
    if not noted:
        return ""
    quota = any(entry["quota_processors"] is not None for entry in noted.values())
    head = ["side", "processors", *_SHARES.values(), *(("quota", "held back") if quota else ())]
    rows = [[side, *_cells(processors[side], quota)] for side in processors]
    text = _NOTE + (_QUOTA_NOTE if quota else "")
    return table("Who had the processors, % of their time", head, rows) + f'<p class="note">{text}</p>'


def _cells(entry: Mapping[str, Any] | None, quota: bool) -> list[str]:
    names = ["n_processors", *_SHARES, *(("quota_processors", "throttled_pct") if quota else ())]
    return ["-" if entry is None else number(entry[name]) for name in names]
