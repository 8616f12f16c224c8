"""The summary as a newcomer reads it in a terminal."""

from typing import Any

from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text


def summary_view(summary: dict[str, Any]) -> RenderableType:
    """Return the summary as text and tables: the answer first, then how it came about."""
    parts: list[RenderableType] = [Text(_headline(summary), style="bold")]
    parts += [Text(f"  not valid: {text}", style="red") for text in summary["problems"]]
    parts += [_limit_line(verdict) for verdict in summary["limits"]]
    for hand, accuracy in (summary.get("accuracy_by_hand") or {"": summary["accuracy"]}).items():
        if accuracy:
            parts.append(_accuracy(accuracy, f" ({hand} hand)" if hand else ""))
    parts += [_links(summary["links"]), _latency(summary["latency_ms"]), Text(_footer(summary))]
    return Group(*parts)


def print_summary(summary: dict[str, Any], console: Console) -> None:
    """Print the summary."""
    console.print(summary_view(summary))


def _headline(summary: dict[str, Any]) -> str:
    late = _number(summary["latency_ms"]["end_to_end"]["p50"], " ms")
    worst = _number(summary["latency_ms"]["end_to_end"]["p99"], " ms")
    lost = _number(summary["links"]["forward"]["loss_pct"], " %")
    estimators = {name: entry for name, entry in summary["accuracy"].items() if name not in ("hold", "plant")}
    best = min(
        (item for item in estimators.items() if item[1]["ratio_to_hold"] is not None),
        key=lambda item: item[1]["ratio_to_hold"],
        default=None,
    )
    line = (
        f"{summary['scenario']} ({summary['mode']}, {summary['source']}): an estimate is {late} old when it is "
        f"published (99 % within {worst}); {lost} of the commands were lost."
    )
    if best is not None:
        name, entry = best
        line += (
            f" {name} errs by {_number(entry['rmse_3d_mm'], ' mm')}, {_number(entry['ratio_to_hold'], ' x')} hold's."
        )
    return line


def _limit_line(verdict: dict[str, Any]) -> Text:
    word, style = {True: ("met", "green"), False: ("missed", "red"), None: ("not decidable", "yellow")}[
        verdict["met"]
    ]
    return Text(
        f"  limit {verdict['name']} <= {verdict['limit']:g}: {word}, {_number(verdict['value'])}", style=style
    )


def _accuracy(accuracy: dict[str, Any], which: str) -> Table:
    table = Table(title=f"Position error at the tick{which}", title_justify="left", caption_justify="left")
    table.add_column("estimator")
    for name in ("R\u00b2 % x", "y", "z", "RMSE mm", "ratio to hold", "step \u00b5s p50", "p99"):
        table.add_column(name, justify="right")
    for name, entry in accuracy.items():
        step = entry.get("step_us", {})
        table.add_row(
            name,
            *(_number(value) for value in entry["r2_pct"]),
            _number(entry["rmse_3d_mm"]),
            _number(entry["ratio_to_hold"]),
            _number(step.get("p50")),
            _number(step.get("p99")),
        )
    table.caption = "hold repeats the newest arm position that arrived; below 1 is better than that"
    return table


def _links(links: dict[str, Any]) -> Table:
    table = Table(title="Network, one way", title_justify="left", caption_justify="left")
    table.add_column("")
    for direction in links:
        table.add_column(direction, justify="right")
    rows = [
        ("packets sent", "sent"),
        ("received", "received"),
        ("dropped by netem", "dropped"),
        ("lost otherwise (unplanned)", "unplanned_loss"),
        ("held at the end", "held_at_end"),
        ("reordered", "reordered"),
    ]
    for title, name in rows:
        table.add_row(title, *(_number(link[name]) for link in links.values()))
    for title, kind in (("delay decided", "decided"), ("delay realised", "realised")):
        for name in ("mean", "std", "p50", "p99", "max"):
            table.add_row(f"{title} {name}, ms", *(_number(link["delay_ms"][kind][name]) for link in links.values()))
    for name in ("p50", "p99", "max"):
        table.add_row(
            f"release error {name}, \u00b5s",
            *(_number(link["release_error_us"][name]) for link in links.values()),
        )
    table.caption = "decided: what the models drew; realised: measured between netem's two sides"
    return table


def _latency(latency: dict[str, Any]) -> Table:
    table = Table(title="Latency, ms", title_justify="left", caption_justify="left")
    table.add_column("")
    for name in ("p50", "p95", "p99", "max"):
        table.add_column(name, justify="right")
    titles = {
        "surgeon": "surgeon (sample taken to sent)",
        "network": "+ network (sent to received)",
        "tick_wait": "+ tick wait (until the next tick)",
        "compute": "+ compute (until published)",
        "end_to_end": "= end to end",
        "round_trip": "round trip (surgeon's clock)",
    }
    for name, title in titles.items():
        table.add_row(title, *(_number(latency[name][p]) for p in ("p50", "p95", "p99", "max")))
    table.caption = "the parts add up sample by sample; their percentiles do not"
    return table


def _footer(summary: dict[str, Any]) -> str:
    ticks = summary["ticks"]
    line = f"Ticks: {ticks['count']} at {ticks['rate_hz']} Hz, {ticks['missed']} missed"
    if ticks["lateness_us"]["p99"]:
        late = ticks["lateness_us"]
        line += f", begun {_number(late['p50'])} \u00b5s late (p99 {_number(late['p99'])})"
    model = summary.get("identification")
    if model:
        kind = "static relation, order 0" if model["static"] else f"order {model['order']}"
        line += f". Model: {model['method']}, {kind}, trained on {model['train']}"
        line += f", fit {' '.join(_number(value) for value in model['fit_pct'])} %."
    return line


def _number(value: float | None, unit: str = "") -> str:
    """Return a number with three or four significant digits, a dash for none."""
    if value is None:
        return "-"
    if isinstance(value, int):
        return f"{value}{unit}"
    digits = 0 if abs(value) >= 1000 else 1 if abs(value) >= 100 else 2 if abs(value) >= 1 else 3
    if 99.9 <= value < 100 and not unit:
        digits = 3
    return f"{value:.{digits}f}{unit}"
