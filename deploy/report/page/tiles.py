"""Headline figures of the report: latency, loss, accuracy, missed ticks."""

from html import escape
from typing import Any

from common.scenario import Scenario
from deploy.report.tables.answer import accuracy_by_hand
from deploy.report.tables.html_tables import nonbreaking_units
from deploy.report.tables.numbers import figure, number
from deploy.report.tables.redundancy_rows import sample_loss_text


def tiles(summary: dict[str, Any], scenario: Scenario) -> str:
    """Return four figures of the summary with their meaning; a dash for an unknown one."""
    parts = [_late(summary), _lossy(summary), _accurate(summary, scenario), _punctual(summary)]
    items = "".join(
        f'<div><dt>{escape(name)}</dt><dd class="value">{escape(value)} <small>{escape(unit)}</small></dd>'
        f'<dd class="beside">{escape(nonbreaking_units(beside))}</dd></div>'
        for name, value, unit, beside in parts
    )
    return f'<dl class="tiles">{items}</dl>'


def _late(summary: dict[str, Any]) -> tuple[str, str, str, str]:
    median, most = (figure(summary, "latency_ms.end_to_end", name) for name in ("p50", "p99"))
    return (
        "How late",
        median,
        "ms",
        f"median, end to end: from newest sample to estimate; in 99 of 100 cases at most {most} ms (p99)",
    )


def _lossy(summary: dict[str, Any]) -> tuple[str, str, str, str]:
    forward, feedback = (summary["links"][direction]["loss_pct"] for direction in ("forward", "feedback"))
    longest = summary["links"]["forward"]["loss_runs"]["longest"]
    beside = f"of the packets to the patient, up to {number(longest)} in a row; {number(feedback)} % of those back"
    samples = sample_loss_text(summary["redundancy"])
    return "How lossy", number(forward), "%", beside if samples is None else f"{beside}; {samples}"


def _accurate(summary: dict[str, Any], scenario: Scenario) -> tuple[str, str, str, str]:
    by_hand, active = accuracy_by_hand(summary, scenario), scenario.active_estimator
    found = [(hand, scores[active]) for hand, scores in by_hand.items() if active in scores]
    value = " / ".join(number(entry["rmse_3d_mm"]) for _, entry in found) or "-"
    ratios = [entry["ratio_to_hold"] for _, entry in found]
    hands = f" ({' / '.join(hand for hand, _ in found)} hand)" if len(found) > 1 else ""
    if not ratios or None in ratios or active == "hold":
        return "How accurate", value, "mm", f"RMSE of {active}, in 3D{hands}"
    share = " / ".join(f"{100 * ratio:.0f}" for ratio in ratios)
    beside = f"RMSE of {active}, in 3D{hands}: {share} % of the error of repeating the last position (hold)"
    return "How accurate", value, "mm", beside


def _punctual(summary: dict[str, Any]) -> tuple[str, str, str, str]:
    ticks = summary["ticks"]
    planned, count = ticks.get("planned"), ticks["count"]
    cut = f" ({planned} were planned)" if planned is not None and count is not None and count < planned else ""
    beside = f"of {number(count)} ticks of the patient{cut}, at {ticks['rate_hz']} Hz"
    if missed := summary["surgeon_ticks"]["missed"]:
        beside += f"; the surgeon missed {missed}"
    if summary["mode"] == "twin":
        beside += "; virtual time has no missed ticks"
    return "Ticks missed", number(ticks["missed"]), "", beside
