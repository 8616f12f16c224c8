"""Tables of the requested and the realised network, by direction and by key."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any, Final

from tis.deploy.report.tables.html_tables import folded, interval, table
from tis.deploy.report.tables.numbers import heads, number
from tis.deploy.report.verdict.verdict_text import undecided_text

_COLUMNS: Final = ("mean", "std", "p50", "p90", "p95", "p99", "p99.9", "max")
_STATISTICS: Final = ("mean", "std", "p50", "p95", "p99", "max")
_MAX_KEYS: Final = 12
_FAITHFUL: Final = {
    True: ("faithful", "good", "the network was the one that {}."),
    False: ("not faithful", "bad", "the network was not the one that {}."),
    None: ("not decidable", "open", "too little was sent to tell whether the network was the one that {}."),
}


def fidelity_list(links: Mapping[str, Any], request: str = "the scenario requests") -> str:
    """Return the verdict on each direction in a sentence, with violations, warnings and undecidable criteria.

    ``request`` completes the sentence "the network was the one that ...".
    """
    items = []
    for direction, link in links.items():
        verdict = link["verdict"]
        word, look, sentence = _FAITHFUL[verdict["faithful"]]
        sentence = sentence.format(request)
        if verdict["faithful"] and (left_open := undecided_text(verdict)):
            word += " in what could be judged"
            sentence = f"{sentence.removesuffix('.')}, as far as this run can show ({left_open})."
        items.append(f'<li><strong class="{look}">{word}</strong> {escape(f"{direction}: {sentence}")}</li>')
        for name, word, look in (("violations", "violated", "bad"), ("warnings", "warning", "open")):
            items += [f'<li><strong class="{look}">{word}</strong> {escape(text)}</li>' for text in verdict[name]]
        if verdict["not_decidable"]:
            items.append(f'<li><span class="note">{escape("; ".join(verdict["not_decidable"]))}</span></li>')
    return f'<ul class="problems">{"".join(items)}</ul>'


def requested_table(links: Mapping[str, Any]) -> str:
    """Return delay and loss of each direction: requested, drawn by the models, and measured."""
    rows = []
    for direction, link in links.items():
        request = link["requested"]
        varies = " (without changes)" if request["varies"] else ""
        for kind, delay in link["delay_ms"].items():
            loss = number(request["loss_pct"]) if kind == "requested" else "-"
            bounds = "-"
            burst = number(request["mean_burst"]) if kind == "requested" else "-"
            if kind == "realised":
                loss, bounds = number(link["loss_pct"]), interval(link["loss_pct_interval_95"])
                burst = number(link["loss_runs"]["mean"])
            name = f"{direction}, {kind}{varies if kind == 'requested' else ''}"
            rows.append((name, *(number(delay[s]) for s in _STATISTICS), loss, bounds, burst))
    losses = ("lost, %", "its 95 % interval, %", "run of losses, mean")
    head = ("direction", *heads(_STATISTICS, "ms"), *losses)
    return table("The network requested, decided and realised: delay one way, and loss", head, rows)


def release_table(links: Mapping[str, Any]) -> str:
    """Return the release error by direction."""
    names = ("p50", "p95", "p99", "max")
    rows = [(d, *(number(link["release_error_us"][name]) for name in names)) for d, link in links.items()]
    return table("Release error: left later than decided by, \u00b5s", ("direction", *heads(names)), rows)


def key_tables(links: Mapping[str, Any]) -> str:
    """Return a folded section with a table for each key of each direction."""
    listed = [(d, title, key) for d, link in links.items() for title, key in link["keys"].items()]
    tables = [key_table(f"{title}, {direction}", key) for direction, title, key in listed[:_MAX_KEYS]]
    n_more = len(listed) - _MAX_KEYS + sum(link["keys_not_listed"] for link in links.values())
    more = f'<p class="note">{n_more} more keys are in summary.json.</p>' if n_more > 0 else ""
    return folded(f"Each of the {min(len(listed), _MAX_KEYS)} keys in numbers", "".join(tables) + more)


def key_table(caption: str, key: Mapping[str, Any]) -> str:
    """Return one key's distributions, and a line with its counts."""
    rows = [(f"delay, {kind}, ms", *_row(delay)) for kind, delay in key["delay_ms"].items()]
    rows += [
        ("above the smallest (PDV), ms", *_row(key["pdv_ms"])),
        ("from one message to the next (IPDV, absolute), ms", *_row(key["ipdv_ms"])),
        ("RFC 3550 jitter, ms", *_row(key["rfc3550_jitter_ms"])),
        ("release error, \u00b5s", *_row(key["release_error_us"])),
    ]
    if key["queued_ms"]["max"]:
        rows.append(("of it in a queue, ms", *_row(key["queued_ms"])))
    request = key["requested"]
    base = " (without changes)" if request["varies"] else ""
    runs = key["loss_runs"]
    line = (
        f"Lost: {number(key['loss_pct'])} % of {number(key['offered'])} (95 % interval "
        f"{interval(key['loss_pct_interval_95'])}), requested{base}: {number(request['loss_pct'])} %; "
        f"{runs['count']} runs, mean length {number(runs['mean'])}, the longest {runs['longest']}. "
        f"Copied: {number(key['copied'])}, corrupted: {number(key['corrupted'])}. Reordered: "
        f"{number(key['reordered_in_netem'])} in netem, {number(key['reordered'])} on arrival. "
        f"Unplanned loss: {number(key['unplanned_loss'])}."
    )
    return table(caption, ("what", *heads(_COLUMNS)), rows) + f'<p class="note">{escape(line)}</p>'


def _row(statistics: Mapping[str, float | None]) -> Sequence[str]:
    return [number(statistics.get(name)) for name in _COLUMNS]
