"""The summary's numbers as tables of a web page: headed, captioned, escaped."""

from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

from deploy.report.table import number

_LATENCY = {
    "surgeon": "surgeon (sample taken to sent)",
    "network": "+ network (sent to received)",
    "tick_wait": "+ tick wait (until the next tick)",
    "compute": "+ compute (until published)",
    "end_to_end": "= end to end",
    "round_trip": "round trip (surgeon's clock)",
}
_LIMITS = {"end_to_end_p99_ms": "99th percentile of the end-to-end latency, ms", "loss_max_pct": "messages lost, %"}
_COLUMNS = ("mean", "std", "p50", "p90", "p95", "p99", "p99.9", "max")
_FAITHFUL = {
    True: ("faithful", "good", "the network did what the scenario asks for, as far as can be told."),
    False: ("not faithful", "bad", "the network did not do what the scenario asks for."),
    None: (
        "not decidable",
        "open",
        "too little was sent to tell whether the network did what the scenario asks for.",
    ),
}
_VERDICTS = {True: ("met", "good"), False: ("missed", "bad"), None: ("not decidable", "open")}


def table(caption: str, head: Sequence[str], rows: Iterable[Sequence[str]], marked: str | None = None) -> str:
    """Return a table; the first cell of each row is its heading, the row whose heading is ``marked`` stands out.

    All cells are plain text and get escaped here.
    """
    columns = "".join(f'<th scope="col">{escape(name)}</th>' for name in head)
    body = []
    for first, *cells in rows:
        chosen = ' class="marked"' if first == marked else ""
        values = "".join(f"<td>{escape(cell)}</td>" for cell in cells)
        body.append(f'<tr{chosen}><th scope="row">{escape(first)}</th>{values}</tr>')
    return (
        f'<div class="wide" role="region" tabindex="0" aria-label="{escape(caption)}"><table>'
        f"<caption>{escape(caption)}</caption><thead><tr>{columns}</tr></thead>"
        f"<tbody>{''.join(body)}</tbody></table></div>"
    )


def accuracy_table(accuracy: dict[str, Any], which: str, active: str) -> str:
    """Return one hand's estimators beside hold."""
    rows = [
        (
            name,
            number(entry["rmse_3d_mm"]),
            number(entry["ratio_to_hold"]),
            *(number(value) for value in entry["r2_pct"]),
            number(entry.get("n_scored")),
            number(entry.get("n_missing")),
            number(entry.get("step_us", {}).get("p50")),
        )
        for name, entry in accuracy.items()
    ]
    head = (
        "estimator", "RMSE in 3D, mm", "of hold's", "R\u00b2 x, %", "R\u00b2 y, %", "R\u00b2 z, %",
        "ticks scored", "of these missing", "median step, \u00b5s",
    )  # fmt: skip
    return table(f"Accuracy at the tick, {which}", head, rows, marked=active)


def limits_list(limits: Sequence[dict[str, Any]]) -> str:
    """Return the limits of the scenario, each met, missed or not decidable; nothing when there are none."""
    items = []
    for verdict in limits:
        word, look = _VERDICTS[verdict["met"]]
        name, _, part = verdict["name"].partition(".")
        title = ", ".join(filter(None, (_LIMITS.get(name, name), part)))
        text = f"{title}: {number(verdict['value'])} (limit {verdict['limit']:g})"
        items.append(f'<li><strong class="{look}">{word}</strong> {escape(text)}</li>')
    return f'<ul class="limits">{"".join(items)}</ul>' if items else ""


def packet_table(links: dict[str, Any]) -> str:
    """Return what became of the messages of both links."""
    names = {
        "sent": "sent",
        "offered": "reached netem",
        "copied": "copies made by netem",
        "dropped": "dropped by netem",
        "released": "released",
        "received": "received",
        "unplanned_loss": "unplanned loss",
        "held_at_end": "under way at the end",
        "reordered": "reordered",
        "duplicated": "duplicated",
        "duplicated_by_netem": "of these by netem",
        "corrupted": "corrupted by netem",
        "corrupted_rejected": "of these refused on arrival",
        "foreign": "foreign",
    }
    rows = [(title, *(number(link.get(name)) for link in links.values())) for name, title in names.items()]
    rows.append(("share lost in netem, %", *(number(link.get("loss_pct")) for link in links.values())))
    rows.append(("its 95 % interval, %", *(_interval(link.get("loss_pct_interval_95")) for link in links.values())))
    rows.append(("dropped because of", *(_reasons(link.get("dropped_by")) for link in links.values())))
    return table("Packets, by direction", ("", *links), rows)


def delay_table(links: dict[str, Any]) -> str:
    """Return the one-way delays in netem and how exactly it kept to them."""
    statistics = ("mean", "std", "p50", "p95", "p99", "max")
    rows = []
    for direction, link in links.items():
        for kind, delay in link["delay_ms"].items():
            if delay["mean"] is not None or kind != "requested":
                rows.append((f"{direction}, {kind}, ms", *(number(delay[name]) for name in statistics)))
        error = link["release_error_us"]
        rows.append(
            (f"{direction}, release error, \u00b5s", "", "", *(number(error[name]) for name in statistics[2:]))
        )
    return table("Delay in netem, one way", ("", *statistics), rows)


def key_tables(links: dict[str, Any], most: int = 12) -> str:
    """Return for each key of each direction its delays asked for, decided and realised, and how exactly it left."""
    listed = [(d, title, key) for d, link in links.items() for title, key in link["keys"].items()]
    tables = [key_table(f"{title}, {direction}", key) for direction, title, key in listed[:most]]
    n_more = len(listed) - most + sum(link["keys_not_listed"] for link in links.values())
    more = f'<p class="note">{n_more} more keys stand in summary.json.</p>' if n_more > 0 else ""
    return "".join(tables) + more


def key_table(caption: str, key: dict[str, Any]) -> str:
    """Return one key's distributions, and what else there is to say about it in a line."""
    rows = [(f"delay, {kind}, ms", *_row(delay)) for kind, delay in key["delay_ms"].items()]
    rows += [
        ("above the smallest (PDV), ms", *_row(key["pdv_ms"])),
        ("from one message to the next (IPDV, absolute), ms", *_row(key["ipdv_ms"])),
        ("RFC 3550 jitter, ms", *_row(key["rfc3550_jitter_ms"])),
        ("release error, \u00b5s", *_row(key["release_error_us"])),
    ]
    if key["queued_ms"]["max"]:
        rows.append(("of it in a queue, ms", *_row(key["queued_ms"])))
    asked = key["requested"]
    base = " (without changes)" if asked["varies"] else ""
    runs = key["loss_runs"]
    line = (
        f"Lost: {number(key['loss_pct'])} % of {number(key['offered'])} (95 % interval "
        f"{_interval(key['loss_pct_interval_95'])}), asked for{base}: {number(asked['loss_pct'])} %; "
        f"{runs['count']} runs, {number(runs['mean'])} long on average, the longest {runs['longest']}. "
        f"Copied: {number(key['copied'])}, corrupted: {number(key['corrupted'])}. Reordered: "
        f"{number(key['reordered_in_netem'])} in netem, {number(key['reordered'])} on arrival. "
        f"Unplanned loss: {number(key['unplanned_loss'])}."
    )
    return table(caption, ("", *_COLUMNS), rows) + f'<p class="note">{escape(line)}</p>'


def verdict_list(links: dict[str, Any]) -> str:
    """Return the verdict on each direction in a sentence, and what was violated, warned of or not decidable."""
    items = []
    for direction, link in links.items():
        verdict = link["verdict"]
        word, look, sentence = _FAITHFUL[verdict["faithful"]]
        items.append(f'<li><strong class="{look}">{word}</strong> {escape(f"{direction}: {sentence}")}</li>')
        for name, word, look in (("violations", "violated", "bad"), ("warnings", "warning", "open")):
            items += [f'<li><strong class="{look}">{word}</strong> {escape(text)}</li>' for text in verdict[name]]
        if verdict["not_decidable"]:
            items.append(f'<li><span class="note">{escape("; ".join(verdict["not_decidable"]))}</span></li>')
    return f'<ul class="problems">{"".join(items)}</ul>'


def latency_table(latency: dict[str, Any]) -> str:
    """Return the latency of the freshest sample, part by part."""
    statistics = ("p50", "p95", "p99", "max")
    rows = [(title, *(number(latency[name][p]) for p in statistics)) for name, title in _LATENCY.items()]
    return table("Latency of the freshest sample, ms", ("", *statistics), rows)


def tick_table(summary: dict[str, Any]) -> str:
    """Return how punctual both sides were."""
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
    return table("Ticks, and how late they began (\u00b5s)", ("side", "ticks", "missed", *statistics), rows)


def _row(statistics: dict[str, float | None]) -> list[str]:
    return [number(statistics.get(name)) for name in _COLUMNS]


def _interval(bounds: Sequence[float] | None) -> str:
    return "-" if bounds is None else f"{number(bounds[0])} to {number(bounds[1])}"


def _reasons(reasons: dict[str, int] | None) -> str:
    return ", ".join(f"{name} {count}" for name, count in (reasons or {}).items()) or "-"
