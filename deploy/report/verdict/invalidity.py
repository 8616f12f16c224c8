"""Problems that make a run invalid, beside damaged logs and books that do not balance."""

from collections.abc import Mapping
from typing import Any, Final

from common.channels import Side
from common.metrics.tracking import SETTLING_NS
from common.records import PEERS
from common.scenario import Scenario
from common.sources.provenance import RECORDING_FILE, parse_played
from common.units import NS_PER_S
from deploy.logs.read.load import RunLogs
from deploy.report.measures.processors import shares_of
from deploy.report.verdict.contention import contention_clause

_MAX_MISSED_TICKS: Final = 0.01
_MAX_UNPLANNED: Final = 0.01
_MAX_WITHOUT_ESTIMATE: Final = 0.01


def invalidities(summary: Mapping[str, Any], scenario: Scenario, logs: RunLogs) -> list[str]:
    """Return a sentence for each problem that the figures of a summary show."""
    return _left(logs) + _starved(summary, scenario, logs) + _without_estimate(summary)


def _left(logs: RunLogs) -> list[str]:
    """Return a problem for each side whose process ended while the others went on, at the first notice of it."""
    noticed: dict[str, tuple[int, Side]] = {}
    for side in logs.sides:
        for row in logs.of(side, PEERS):
            noticed[row["peer"]] = min(noticed.get(row["peer"], (row["at_ns"], side)), (row["at_ns"], side))
    return [f"{peer} left at {at_ns / NS_PER_S:.1f} s, as {side} noticed" for peer, (at_ns, side) in noticed.items()]


def two_recordings(logs: RunLogs) -> list[str]:
    """Return a problem when surgeon and patient read different recordings under one name."""
    sides: tuple[Side, ...] = ("surgeon", "patient")
    attached = {side: logs.attachments(side).get(RECORDING_FILE) for side in sides}
    played = {side: parse_played(data, f"{side}.mcap")[1] for side, data in attached.items() if data is not None}
    if len({one["digest"] for one in played.values()}) < len(sides):
        return []
    files = " and ".join(f"{side}: {one['file'] or one['label']}" for side, one in played.items())
    return [f"recording: surgeon and patient have read different ones ({files})"]


def _starved(summary: Mapping[str, Any], scenario: Scenario, logs: RunLogs) -> list[str]:
    """Return the problems of a run that was starved, ended early, lost messages outside netem or has no score."""
    problems = []
    owners: dict[str, tuple[Side, str]] = {
        "ticks": ("patient", "the run ended early"),
        "surgeon_ticks": ("surgeon", "the surgeon ended early"),
    }
    for name, (side, early) in owners.items():
        count, covered = summary[name]["count"], logs.coverage(side)
        if count is None or count >= scenario.n_samples:
            continue
        if covered is None or covered.whole:
            problems.append(f"{name}: {count} of {scenario.n_samples} happened, {early}")
        else:
            problems.append(f"{name}: the log tells of {count} of {scenario.n_samples}")
    for name, (side, _) in owners.items():
        missed, count = summary[name]["missed"], summary[name]["count"]
        if count is not None and missed > _MAX_MISSED_TICKS * count:
            cause = contention_clause(shares_of(logs, side), side)
            problems.append(f"{name}: {missed} of {count} missed, the machine is too busy{cause}")
    for direction, link in summary["links"].items():
        unplanned, sent = link["unplanned_loss"], link["sent"]
        if unplanned is not None and unplanned > _MAX_UNPLANNED * sent:
            problems.append(f"links.{direction}: {unplanned} of {sent} lost that nobody planned")
    if not any(entry.get("n_scored") for entry in summary["accuracy"].values()):
        problems.append(f"accuracy: no tick could be scored: {why_unscored(logs, scenario)}")
    return problems


def _without_estimate(summary: Mapping[str, Any]) -> list[str]:
    """Return a problem when the active estimator had no estimate at many scored ticks."""
    name = summary["active_estimator"]
    entry = summary["accuracy"].get(name, {})
    n_missing, n_scored = entry.get("n_missing", 0), entry.get("n_scored", 0)
    if n_missing <= _MAX_WITHOUT_ESTIMATE * n_scored:
        return []
    return [f"accuracy: {name} gave no estimate at {n_missing} of {n_scored} scored ticks, where hold's is scored"]


def why_unscored(logs: RunLogs, scenario: Scenario) -> str:
    """Return the reason why no tick is scored."""
    arrivals = logs.messages("patient", "forward", scenario.session).values()
    first_ns = min((int(one.log_ns.min()) for one in arrivals if len(one)), default=None)
    if first_ns is None:
        return "no message is known to have reached the patient"
    first_s, settling_s = first_ns / NS_PER_S, SETTLING_NS / NS_PER_S
    if scenario.duration_s <= first_s + settling_s:
        return (
            f"ticks count from {settling_s:g} s after the first arrival (at {first_s:.3f} s), when filters have "
            f"settled, and the run lasts {scenario.duration_s:g} s"
        )
    return "there is no tick at which both the truth and hold's estimate are known"
