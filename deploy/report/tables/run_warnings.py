"""Warnings on a run's figures, in sentences, for terminal and report."""

from collections.abc import Mapping
from typing import Any

from deploy.report.measures.devices import device_texts
from deploy.report.measures.estimation.own_estimators import estimator_fault_texts
from deploy.report.measures.evidence import evidence_texts
from deploy.report.measures.network.refusals import refusal_texts
from deploy.report.tables.numbers import number


def run_warnings(summary: Mapping[str, Any]) -> list[str]:
    """Return the warnings on a run's figures: sides, devices, estimators, models, the recording's."""
    recording = summary.get("recording") or {}
    return [
        *_absence_texts(summary),
        *_quarantine_text(summary),
        *evidence_texts(summary),
        *_stop_texts(summary),
        *device_texts(summary),
        *refusal_texts(summary.get("refused", {})),
        *estimator_fault_texts(summary),
        *(summary.get("in_sample") or []),
        *recording.get("warnings", []),
    ]


def _stop_texts(summary: Mapping[str, Any]) -> list[str]:
    """Return a sentence on emergency stops; none without any."""
    hands = [row for row in summary.get("safety", {}).values() if row is not None and row["emergency_stops"]]
    if not hands:
        return []
    n, safe_s = hands[0]["emergency_stops"], max(row["time_s"]["safe"] for row in hands)
    times = "an emergency stop" if n == 1 else f"{n} emergency stops"
    stops = [row["stop"] for row in hands if row.get("stop") and row["stop"]["way_mm"] is not None]
    within = ""
    if stops:
        longest = max(stops, key=lambda one: float(one["way_mm"]))
        within = (
            f" within {longest['way_mm']:.1f} mm and {max(one['time_ms'] for one in stops):.0f} ms "
            f"(allowed: {longest['bound_mm']:.1f} mm, {longest['bound_ms']:.0f} ms)"
        )
    return [f"{times} stopped the arms{within}, which stood still for {safe_s:.1f} s: the errors count that time"]


def _absence_texts(summary: Mapping[str, Any]) -> list[str]:
    """Return a sentence on each time without a side that was started anew in mid-run."""
    return [
        f"{side} was away from {begin_s:.2f} to {end_s:.2f} s and was started anew: that time "
        f"{'counts' if log['away_counts'] else 'is left out'} (on_rejoin)"
        for side, log in summary.get("logs", {}).items()
        for begin_s, end_s in log.get("away_s", ())
    ]


def _quarantine_text(summary: Mapping[str, Any]) -> list[str]:
    """Return a sentence on the messages that the patient's gate did not let through; none without any."""
    found = {kind: n for kind, n in summary.get("quarantined", {}).items() if n}
    kinds = ", ".join(f"{number(n)} {kind}" for kind, n in found.items())
    n = number(sum(found.values()))
    return [f"the patient did not use {n} samples ({kinds}; see patient.gate)"] if found else []
