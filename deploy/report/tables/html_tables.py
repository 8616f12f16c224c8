"""The summary's numbers as HTML tables, escaped and in one style.

Numbers are right-aligned, words left-aligned. A unit appears once: in the caption if all columns share it, else in
the column's head, or in the row where rows differ.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any, Final

from tis.deploy.report.tables.numbers import LATENCY_PARTS, ROUND_TRIP, figure, heads, number
from tis.deploy.report.tables.redundancy_rows import COLUMNS, NOTE, redundancy_rows, redundancy_text

_LATENCY = {
    **LATENCY_PARTS,
    "actuation": "actuation (until the arm is there), after that",
    "network_round_trip": "the network's round trip",
    "round_trip": ROUND_TRIP,
}
_SHORT: Final = re.compile(r", (?=\S{1,3}$)")
_UNITS: Final = r"(?:%|ms|mm|\u00b5s|s|Hz|KB|MB|kB/s)"
_GAP: Final = re.compile(rf"(?<=\d) (?={_UNITS}(?!\w))")
_ALWAYS = ("surgeon", "network", "tick_wait", "compute", "end_to_end", "round_trip")


def table(
    caption: str,
    head: Sequence[str],
    rows: Iterable[Sequence[str]],
    marked: str | None = None,
    texts: Sequence[int] = (),
) -> str:
    """Return a table of plain text, which is escaped here.

    The first cell of each row is its heading; the row with heading ``marked`` is highlighted. Columns ``texts`` hold
    words.
    """
    cells = [[escape(cell) for cell in row] for row in rows]
    return markup_table(caption, head, cells, marked and escape(marked), texts)


def markup_table(
    caption: str,
    head: Sequence[str],
    rows: Iterable[Sequence[str]],
    marked: str | None = None,
    texts: Sequence[int] = (),
) -> str:
    """Return a table of safe markup; columns ``texts`` hold words and may wrap, the others but the first numbers.

    Each cell knows the head of its column, which a narrow page shows beside it when it stacks the cells of a row.
    """
    looks = [' class="text"' if i in texts else "" for i in range(len(head))]
    columns = "".join(f'<th scope="col"{look}>{escape(_bound(n))}</th>' for n, look in zip(head, looks, strict=True))
    body = []
    for first, *cells in rows:
        chosen = ' class="marked"' if first == marked else ""
        values = "".join(
            f'<td{look} data-head="{escape(name)}">{cell}</td>'
            for cell, look, name in zip(cells, looks[1:], head[1:], strict=True)
        )
        body.append(f'<tr{chosen}><th scope="row">{first}</th>{values}</tr>')
    return (
        f'<div class="wide" role="region" tabindex="0" aria-label="{escape(caption)}"><table>'
        f"<caption>{escape(caption)}</caption><thead><tr>{columns}</tr></thead>"
        f"<tbody>{''.join(body)}</tbody></table></div>"
    )


def _bound(head: str) -> str:
    """Return a column's head with its unit on the line of the word before it."""
    return _SHORT.sub(",\u00a0", head)


def nonbreaking_units(text: str) -> str:
    """Return the text with no-break spaces (U+00A0) between numbers and their units."""
    return _GAP.sub("\u00a0", text)


def folded(title: str, markup: str) -> str:
    """Return markup folded under a title, left out on paper."""
    return f"<details><summary>{escape(title)}</summary>{markup}</details>" if markup else ""


def packet_table(links: Mapping[str, Any]) -> str:
    """Return the packet counts of both links."""
    names = {
        "sent": "sent",
        "offered": "reached netem",
        "copied": "copies made by netem",
        "dropped": "dropped by netem",
        "released": "released",
        "received": "received",
        "unplanned_loss": "unplanned loss",
        "held_at_end": "in flight at the end",
        "reordered": "reordered",
        "duplicated": "duplicated",
        "duplicated_by_netem": "of these by netem",
        "corrupted": "corrupted by netem",
        "corrupted_rejected": "of these rejected on arrival",
        "foreign": "foreign",
    }
    rows = [(title, *(number(link.get(name)) for link in links.values())) for name, title in names.items()]
    rows.append(("share lost in netem, %", *(number(link.get("loss_pct")) for link in links.values())))
    rows.append(("its 95 % interval, %", *(interval(link.get("loss_pct_interval_95")) for link in links.values())))
    reasons = dict.fromkeys(reason for link in links.values() for reason in link.get("dropped_by") or {})
    rows += [(f"dropped because of {why}", *(_dropped(link, why) for link in links.values())) for why in reasons]
    return table("Packets, by direction", ("what became of them", *links), rows)


def redundancy_table(found: Mapping[str, Any]) -> str:
    """Return cost and gain of redundancy; "" without redundancy."""
    rows = [(title, number(as_sent), number(once)) for title, as_sent, once in redundancy_rows(found)]
    if not rows:
        return ""
    caption = f"What redundancy cost and gained: {redundancy_text(found)}"
    return table(caption, ("figure", *COLUMNS), rows) + f'<p class="note">{NOTE}.</p>'


def latency_table(summary: Mapping[str, Any]) -> str:
    """Return the latency of the freshest sample by part, with clock uncertainty."""
    statistics = ("p50", "p95", "p99", "max")
    rows = [
        (title, *(figure(summary, f"latency_ms.{name}", p) for p in statistics))
        for name, title in _LATENCY.items()
        if name in summary["latency_ms"] and (name in _ALWAYS or summary["latency_ms"][name]["p50"] is not None)
    ]
    return table("Latency of the freshest sample, ms", ("part", *heads(statistics)), rows)


def tick_mode_table(modes: Mapping[str, Any]) -> str:
    """Return the age of samples under each mode of the patient's tick; the run's own mode is marked."""
    rows = []
    for mode in ("free", "phase_locked", "on_arrival"):
        entry = modes[mode]
        age = entry["age_when_used_ms"]
        saves = number(entry["saves_ms"])
        rows.append((mode, number(age["mean"]), number(age["p50"]), number(age["p99"]), saves))
    head = ("patient.tick", *heads(("mean", "p50", "p99")), "saves, mean")
    caption = "Age of a sample when a tick first uses it, ms, and what another mode of the tick would save"
    return table(caption, head, rows, marked=modes["mode"])


def tick_table(summary: Mapping[str, Any]) -> str:
    """Return tick counts and lateness of both sides."""
    statistics = ("p50", "p95", "p99", "max")
    sides = {"patient": summary["ticks"], "surgeon": summary["surgeon_ticks"]}
    rows = [
        (
            side,
            number(ticks["count"]),
            number(ticks["missed"]),
            *(number(ticks["lateness_us"][name]) for name in statistics),
        )
        for side, ticks in sides.items()
    ]
    lateness = (f"late, {name}" for name in heads(statistics, "\u00b5s"))
    return table("Ticks, and how late they began", ("side", "ticks", "missed", *lateness), rows)


def interval(bounds: Sequence[float] | None) -> str:
    """Return an interval as text."""
    return "-" if bounds is None else f"{number(bounds[0])} to {number(bounds[1])}"


def _dropped(link: Mapping[str, Any], reason: str) -> str:
    return "-" if link.get("dropped_by") is None else number(link["dropped_by"].get(reason, 0))
