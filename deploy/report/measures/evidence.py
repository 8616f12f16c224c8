"""The summary's ``evidence``: what only somebody who forges can have caused, since when, and what followed."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from tis.common.peer_life import Alarm
from tis.common.records import COUNTERS
from tis.common.safety_records import QUARANTINED, SINCE_MS
from tis.common.scenario import Scenario
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.deploy.logs.read.load import RunLogs

_COUNTERS: Final[Mapping[Alarm, str]] = {
    "conflict": f"{QUARANTINED}.conflicting",
    "foreign_set_point": "foreign_set_points",
}


def evidence_summary(logs: RunLogs, scenario: Scenario) -> dict[str, Any]:
    """Return the number of contradictions of each kind, null if unknown, and since when; null: never evidence."""
    rows = logs.of("patient", COUNTERS) if "patient" in logs.sides else ()
    counters = {row["name"]: row["value"] for row in rows}
    found: dict[str, Any] = {"on_conflict": scenario.on_conflict}
    for alarm, counter in _COUNTERS.items():
        since_ms = counters.get(f"{SINCE_MS}.{alarm}")
        found[alarm] = {
            "n": counters.get(counter),
            "begun_s": None if since_ms is None else since_ms * NS_PER_MS / NS_PER_S,
        }
    return found


def evidence_texts(summary: Mapping[str, Any]) -> Sequence[str]:
    """Return a sentence on each kind of evidence that a run holds; none without any."""
    evidence, found = summary.get("evidence") or {}, []
    conflict, foreign = evidence.get("conflict"), evidence.get("foreign_set_point")
    if conflict and conflict["begun_s"] is not None:
        acts = "the arm held while they came" if evidence["on_conflict"] == "hold" else "the arm went on"
        found.append(
            f"{conflict['n']} samples of the surgeon came in a second version, from {conflict['begun_s']:.1f} s on: "
            f"somebody forges them; {acts} (patient.gate.on_conflict)"
        )
    if foreign and foreign["n"]:
        since = "" if foreign["begun_s"] is None else f", from {foreign['begun_s']:.1f} s on"
        found.append(
            f"somebody else sent {foreign['n']} set points for the arms{since}: an arm may have followed them"
        )
    return found


def evidence_problems(summary: Mapping[str, Any], scenario: Scenario) -> list[str]:
    """Return a problem where an arm of another program heard set points that the patient did not send."""
    n = summary.get("evidence", {}).get("foreign_set_point", {}).get("n")
    if not n or scenario.patient.plant.kind != "external":
        return []
    return [f"evidence.foreign_set_point: the arm heard {n} set points that the patient did not send"]
