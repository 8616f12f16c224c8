"""The summary in a terminal."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from rich import box
from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from tis.common.metrics.percentiles import is_resolvable
from tis.common.metrics.verdict import SetVerdict
from tis.common.sources.provenance import RecordedRows, in_words
from tis.deploy.report.measures.estimation.own_estimators import labelled
from tis.deploy.report.tables.brief import brief
from tis.deploy.report.tables.delay_rows import STATISTICS, delay_rows
from tis.deploy.report.tables.display_table import display_views
from tis.deploy.report.tables.hanging_indent import HangingIndent
from tis.deploy.report.tables.numbers import (
    LATENCY_PARTS,
    ROUND_TRIP,
    broken_name,
    figure,
    heads,
    number,
    rounded_up,
    unresolved_latency,
)
from tis.deploy.report.tables.orientation_table import orientation_rows
from tis.deploy.report.tables.redundancy_rows import (
    COLUMNS,
    NOTE,
    kilo,
    redundancy_rows,
    redundancy_text,
    sample_loss_text,
)
from tis.deploy.report.tables.run_warnings import run_warnings
from tis.deploy.report.verdict.verdict_text import (
    FIDELITY_STYLES,
    OUT_OF_REACH,
    fidelity_text,
    outcome_text,
    validity_text,
)
from tis.patient_side.identification.validation import fit_text

# The orientation methods' errors in a terminal.

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


_MAX_SENTENCES: Final = 6
_NAME_WIDTH: Final = 17

END_TO_END: Final = (
    "End to end: from the instant of the newest sample behind an estimate, command or arm position, whichever "
    "arrived first, to the estimate's publication. It can be below a link's one-way delay, which counts every "
    "message, the slow and the overtaken ones too"
)
"""Definition of the end-to-end latency, and why it can be smaller than a one-way delay."""


def summary_view(summary: dict[str, Any], since: str | None = None) -> RenderableType:
    """Return the summary as text and tables, the result first; ``since`` as in `validity_text`."""
    parts: list[RenderableType] = [Text(_headline(summary), style="bold")]
    parts.append(Text(validity_text(summary, since), style="red" if since or not summary["valid"] else ""))
    parts += [HangingIndent(f"not valid: {text}", "red") for text in summary["problems"]]
    parts += [HangingIndent(f"warning: {text}", "yellow") for text in run_warnings(summary)]
    parts += [_verdict_lines(d, link["verdict"]) for d, link in summary["links"].items() if "verdict" in link]
    for hand, accuracy in (summary.get("accuracy_by_hand") or {"": summary["accuracy"]}).items():
        if accuracy:
            parts.append(_accuracy(accuracy, f" ({hand} hand)" if hand else ""))
    parts += orientation_views(summary)
    parts += display_views(summary["display"])
    links = summary["links"]
    parts += [_redundancy(summary["redundancy"])] if redundancy_rows(summary["redundancy"]) else []
    parts += [_packets(links), delays_view(links), _latency(summary), Text(f"\n{_footer(summary)}")]
    parts += [Text(summary["tick_modes"]["line"]), Text("\nRequirements of applications:", style="bold")]
    parts += [_verdict_line(verdict, summary["ticks"]["rate_hz"]) for verdict in summary["verdicts"]]
    return Group(*parts)


def print_summary(summary: dict[str, Any], console: Console, since: str | None = None, verbose: bool = False) -> None:
    """Print the brief, or all tables if ``verbose``; ``since`` names damage to the logs after it was written."""
    if verbose:
        console.print(summary_view(summary, since))
    else:
        console.print(brief(summary, run_warnings(summary), console.width, since), soft_wrap=True)


def _headline(summary: dict[str, Any]) -> str:
    """Return latency, loss and accuracy, a line each."""
    median, p99 = (figure(summary, "latency_ms.end_to_end", name, " ms") for name in ("p50", "p99"))
    lost = number(summary["links"]["forward"]["loss_pct"], " %")
    oldest = figure(summary, "age_ms", "max", " ms")
    latency = (
        f"end to end, sample to estimate: median {median}, p99 {p99}.\n"
        f"At the ticks the newest sample was at most {oldest} old"
    )
    text = (
        f"{summary['scenario']} ({summary['mode']}, {summary['source']}):\n{unresolved_latency(summary) or latency}."
        f"\n{lost} of the packets to the patient were lost."
    )
    if samples := sample_loss_text(summary["redundancy"]):
        text += f"\nThe surgeon sent {redundancy_text(summary['redundancy'])}: {samples}."
    name = summary["active_estimator"]
    entry = summary["accuracy"].get(name)
    if entry is not None and entry["ratio_to_hold"] is not None:
        text += f"\n{name} errs by {number(entry['rmse_3d_mm'], ' mm')} (RMSE in 3D), "
        text += f"{100 * entry['ratio_to_hold']:.0f} % of the error of repeating the newest position (hold)."
    return text


def _verdict_line(verdict: SetVerdict, rate_hz: int) -> HangingIndent:
    outcome = outcome_text(verdict, rate_hz)
    style = {"met": "green", "missed": "red", "not decidable": "yellow", OUT_OF_REACH: ""}[outcome]
    at_rate = f"{OUT_OF_REACH} at {rate_hz} Hz" if outcome == OUT_OF_REACH else outcome
    return HangingIndent(verdict["line"].replace(verdict["outcome"].replace("_", " "), at_rate, 1), style)


def _verdict_lines(direction: str, verdict: dict[str, Any]) -> Group:
    """Return the fidelity of a direction, with violations and warnings."""
    words, style = fidelity_text(verdict, "the scenario"), FIDELITY_STYLES[verdict["faithful"]]
    shown = [*verdict["violations"], *(f"warning: {warning}" for warning in verdict["warnings"])]
    lines = shown[:_MAX_SENTENCES]
    if len(shown) > _MAX_SENTENCES:
        lines.append(f"and {len(shown) - _MAX_SENTENCES} more, see summary.json")
    return Group(
        HangingIndent(f"network {direction}: {words}", style),
        *(HangingIndent(sentence, style, indent=4) for sentence in lines),
    )


def _table(title: str, columns: Sequence[str]) -> Table:
    """Return an empty table that fits 80 columns: names first, then numbers."""
    table = Table(title=f"\n{title}", title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    first, *numbers = columns
    table.add_column(first, no_wrap=True)
    for name in numbers:
        table.add_column(name, justify="right", no_wrap=True)
    return table


def _noted(table: Table, note: str) -> RenderableType:
    """Return a table with a note below it; rich would wrap a caption to the width of the table."""
    return Group(table, Text(note, style="table.caption"))


def _accuracy(accuracy: dict[str, Any], which: str) -> RenderableType:
    timed = has_step_times(accuracy)
    steps = ("\u00b5s\nmedian", "\np99") if timed else ()
    table = _table(
        f"Position error at the tick{which}", ("estimator", "R\u00b2 % x", "y", "z", "RMSE mm", "/ hold", *steps)
    )
    for name, entry in accuracy.items():
        step = entry.get("step_us", {})
        times = (step.get("p50"), step.get("p99")) if timed else ()
        numbers = (*entry["r2_pct"], entry["rmse_3d_mm"], entry["ratio_to_hold"], *times)
        table.add_row(broken_name(labelled(name, entry), _NAME_WIDTH), *(number(value) for value in numbers))
    note = "hold repeats the newest arm position that arrived"
    return _noted(table, f"{note}; \u00b5s: time of one step" if timed else note)


def has_step_times(accuracy: Mapping[str, Any]) -> bool:
    """Tell whether any estimator has step times; virtual time has none."""
    return any(entry.get("step_us", {}).get("p50") is not None for entry in accuracy.values())


def send_rate_text(found: Mapping[str, Any]) -> str | None:
    """Return packets and bytes per second that the surgeon sends; None when unknown."""
    price = found["price"]
    if price["packets_per_s"] is None:
        return None
    return f"{number(price['packets_per_s'])} packets/s, {number(kilo(price['bytes_per_s']))} kB/s"


def _redundancy(found: Mapping[str, Any]) -> RenderableType:
    table = _table(f"Redundancy: {redundancy_text(found)}", ("", *COLUMNS))
    for title, as_sent, once in redundancy_rows(found):
        table.add_row(title, number(as_sent), number(once))
    return _noted(table, NOTE)


def _packets(links: dict[str, Any]) -> RenderableType:
    names = {
        "sent": "sent",
        "received": "received",
        "dropped": "dropped",
        "unplanned_loss": "unplanned",
        "held_at_end": "held at end",
        "reordered": "reordered",
    }
    table = _table("Packets", ("", *names.values()))
    for direction, link in links.items():
        table.add_row(direction, *(number(link[name]) for name in names))
    n_unlogged = sum(link["untold"] for link in links.values())
    note = f"dropped: by netem{drop_reasons(links)}; unplanned: lost elsewhere; held: in flight at the end"
    note += f"; {n_unlogged} more are left out: they fall into gaps of damaged logs" if n_unlogged else ""
    return _noted(table, note)


def drop_reasons(links: Mapping[str, Any]) -> str:
    """Return the reasons that occurred, as `` (forward: 3 loss, 705 queue_full)``; "" without any drop."""
    parts = [
        f"{direction}: " + ", ".join(f"{n} {reason}" for reason, n in link["dropped_by"].items())
        for direction, link in links.items()
        if link.get("dropped_by")
    ]
    return f" ({'; '.join(parts)})" if parts else ""


def delays_view(links: dict[str, Any], requested: str = "by the scenario") -> RenderableType:
    """Return the table of delays in netem; ``requested`` names the source of the request."""
    table = _table("Delay in netem, one way", ("", *heads(STATISTICS)))
    found = delay_rows(links)
    for row in found.rows:
        cells = [number(value) for value in row.values]
        table.add_row(row.name, *[""] * (len(STATISTICS) - len(cells)), *cells)
    note = f"requested: {requested}; decided: drawn by its models; realised: measured in netem; "
    return _noted(table, "; ".join([f"{note}release error: left later than decided by", *found.notes]))


def _latency(summary: dict[str, Any]) -> RenderableType:
    names = ("p50", "p95", "p99", "max")
    bounds = summary.get("uncertainty_ms", {})
    caption = f"{END_TO_END}; in topology observer commands cross unimpaired. "
    caption += "The parts add up sample by sample; their medians and percentiles do not"
    if bounds:
        caption += "\n\u00b1: clock uncertainty of a row; ?: not resolvable, the uncertainty exceeds the figure"
    table = _table("Latency of the freshest sample, ms", ("", *heads(names), *(["\u00b1"] if bounds else [])))
    titles = {
        **LATENCY_PARTS,
        "actuation": "then the arm follows",
        "round_trip": ROUND_TRIP,
        "network_round_trip": "of it in the network",
    }
    for name, title in titles.items():
        if name == "actuation" and summary["latency_ms"][name]["p50"] is None:
            continue
        row, bound = summary["latency_ms"][name], bounds.get(f"latency_ms.{name}", {})
        cells = [number(row[p]) if is_resolvable(row[p], bound.get(p)) else "?" for p in names]
        widest = max((ms for ms in bound.values() if ms is not None), default=None)
        table.add_row(title, *cells, *(["-" if widest is None else rounded_up(widest, 2)] if bound else []))
    return _noted(table, caption)


def trained_on(identification: Mapping[str, Any]) -> str:
    """Return a model's training data in words: its name, and the recordings of a model file."""
    file = identification.get("model_file")
    if file is None:
        return str(identification["train"])
    rows = [RecordedRows(**each) for each in identification["trained_on"]]
    return f"{file} ({identification['train']}: {in_words(rows)})"


def _footer(summary: dict[str, Any]) -> str:
    ticks = summary["ticks"]
    planned, count = ticks.get("planned"), ticks["count"]
    of = f" of {planned}" if planned is not None and count is not None and count < planned else ""
    line = f"Ticks of the patient: {number(count)}{of} at {ticks['rate_hz']} Hz, {number(ticks['missed'])} missed"
    if ticks["lateness_us"]["p99"]:
        late = ticks["lateness_us"]
        line += f", begun late by median {number(late['p50'])}, p99 {number(late['p99'])} \u00b5s"
    surgeon = summary["surgeon_ticks"]["missed"]
    line += f"; the surgeon missed {number(surgeon)}"
    if surgeon and ticks["missed"] is not None:
        line += f", so {surgeon + ticks['missed']} in all"
    if rate := send_rate_text(summary["redundancy"]):
        line += f". Sent by the surgeon: {rate}"
    model = summary.get("identification")
    if model:
        kind = "static relation, order 0" if model["static"] else f"order {model['order']}"
        line += f". Model: {model['method']}, {kind}, trained on {trained_on(model)}"
        line += f", fit {' '.join(fit_text(value, 3) for value in model['fit_pct'])} %."
    return line
