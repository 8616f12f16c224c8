"""Warnings on a run's figures, in sentences, for terminal and report."""

from collections.abc import Mapping, Sequence
from typing import Any

from tis.deploy.report.measures.devices import device_texts
from tis.deploy.report.measures.estimation.own_estimators import estimator_fault_texts
from tis.deploy.report.measures.evidence import evidence_texts
from tis.deploy.report.measures.network.refusals import refusal_texts
from tis.deploy.report.tables.numbers import number


def run_warnings(summary: Mapping[str, Any]) -> list[str]:
    """Return the warnings on a run's figures: sides, devices, estimators, models, the recording's."""
    recording = summary.get("recording") or {}
    return [
        *evidence_texts(summary),
        *_absence_texts(summary),
        *_quarantine_text(summary),
        *_stop_texts(summary),
        *device_texts(summary),
        *refusal_texts(summary.get("refused", {})),
        *estimator_fault_texts(summary),
        *(summary.get("in_sample") or []),
        *recording.get("warnings", []),
    ]


def _stop_texts(summary: Mapping[str, Any]) -> list[str]:
    """Return sentences on emergency stops, on releases without the stop's token, and on what was refused.

    None of them makes a run invalid: its figures are what happened, and the arms stood where they were to stand.
    """
    hands = [row for row in summary.get("safety", {}).values() if row is not None]
    if not hands:
        return []
    books, safe_s = hands[0], max(row["time_s"]["safe"] for row in hands)
    n_stops, n_others = books["emergency_stops"], books.get("releases_by_others", 0)
    n_refused, n_flooded = books.get("stop_requests_refused", 0), books.get("stop_requests_flooded", 0)
    texts = []
    if n_stops:
        stopped = f"{_times('emergency stop', n_stops)} stopped the arms{_within(hands)}, which stood still for "
        stopped += f"{safe_s:.1f} s"
        texts.append(f"{stopped}: the errors count that time")
    if n_others:
        releases = _times("release", n_others)
        texts.append(f"{releases} came without the stop's token (patient.safety.release says who may)")
    if n_refused:
        texts.append(f"the patient refused {_times('request', n_refused)} to stop or to release (reasons in the log)")
    if n_flooded:
        n_releases = books.get("releases", 0)
        n_all = n_stops + n_releases + n_refused + n_flooded
        done = f"{_times('stop', n_stops)} and {_times('release', n_releases)}"
        texts.append(
            f"a flood of {number(n_all)} requests to stop or to release: the patient carried out {done}, the others "
            "had no effect"
        )
    return texts


def _within(hands: Sequence[Mapping[str, Any]]) -> str:
    """Return the longest way and time of the stops beside what is allowed; "" where none is known."""
    stops = [row["stop"] for row in hands if row.get("stop") and row["stop"]["way_mm"] is not None]
    if not stops:
        return ""
    way_mm, time_ms = (max(one[name] for one in stops) for name in ("way_mm", "time_ms"))
    allowed = f"{stops[0]['bound_mm']:.1f} mm, {stops[0]['bound_ms']:.0f} ms"
    return f" within {way_mm:.1f} mm and {time_ms:.0f} ms (allowed: {allowed})"


def _times(what: str, n: int) -> str:
    article = "an" if what[0] in "aeiou" else "a"
    return f"{article} {what}" if n == 1 else f"{number(n)} {what}s"


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
