"""Messages from elsewhere: refused, rejected and quarantined ones, and evidence that somebody forges."""

from collections.abc import Mapping, Sequence
from typing import Final, get_args

from tis.common.channels import Side
from tis.common.errors import problem
from tis.common.peer_life import Alarm
from tis.common.refusal import MEANING, REFUSED, Refusal
from tis.common.safety_records import QUARANTINED, SINCE_MS
from tis.common.scenario import Scenario
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.present.numbers import number
from tis.deploy.report.section import Section, means
from tis.deploy.report.subjects.logs import count_of, counters_of
from tis.patient_side.safety.gate import LIMIT_OF, Kind


class AlarmFigures(Section):
    """A kind of evidence."""

    n: int | None = means("Messages of this kind.")
    begun_s: float | None = means(
        "Run time at which three came within a second, so that somebody forges; `null`: they never did."
    )


class Evidence(Section):
    """What only somebody who forges can have caused."""

    on_conflict: str = means("What followed contradictions between samples: hold or warn.")
    conflict: AlarmFigures = means("Samples that came in a second version, under one number or instant.")
    foreign_set_point: AlarmFigures = means(
        "Set points for the arms that somebody else sent on the patient's network."
    )


_COUNTERS: Final[Mapping[Alarm, str]] = {
    "conflict": f"{QUARANTINED}.conflicting",
    "foreign_set_point": "foreign_set_points",
}
_KINDS: Final[Mapping[str, str]] = {
    "conflicting": "contradicting others",
    "ahead": "stamped later than now",
    "number": "with a number that is not their instant's",
    "place": "out of the arm's reach",
    "speed": "faster than it moves",
    "acceleration": "with a jump of speed",
    "turn_speed": "turning faster than it does",
    "turn_acceleration": "with a jump in turning",
    "gripper": "with too wide a gripper, or too fast",
}
"""What is wrong with the samples of a kind, in words that follow their number."""
OTHER_RUN: Final = "other_run"
CONFLICTING: Final = "conflicting"
_OF_SIDES: Final[Mapping[str, tuple[str, tuple[Side, ...]]]] = {
    OTHER_RUN: ("a message of another run", ("surgeon", "patient")),
    "unsigned": ("a message without a code", ("surgeon", "patient")),
    "wrong_code": ("a message whose code is wrong", ("surgeon", "patient")),
    CONFLICTING: ("a second content under one sequence number", ("surgeon",)),  # the patient's are quarantined
}


def refused(logs: RunLogs) -> dict[str, int | None]:
    """Return the number of refusals by kind; None where a log that counts them is missing or ended early."""
    counts: dict[str, int | None] = {
        kind: _count_of(logs, "netem", f"{REFUSED}.{kind}") for kind in get_args(Refusal)
    }
    for kind, (_, sides) in _OF_SIDES.items():
        found = [_count_of(logs, side, kind) for side in sides]
        counts[kind] = None if None in found else sum(n or 0 for n in found)
    return counts


def refusal_texts(counts: Mapping[str, int | None]) -> list[str]:
    """Return a sentence on what was refused; none without any."""
    words: dict[str, str] = dict(MEANING.items()) | {kind: text for kind, (text, _) in _OF_SIDES.items()}
    found = [f"{words.get(kind, kind)}{f' ({n} times)' if n > 1 else ''}" for kind, n in counts.items() if n]
    return [f"refused: {'; '.join(found)}"] if found else []


def _count_of(logs: RunLogs, side: Side, name: str) -> int | None:
    """Return a counter that is only written when it is above 0; None without any counters."""
    rows = counters_of(logs, side)
    return int(rows.get(name, 0)) if rows else None


def quarantined(logs: RunLogs) -> dict[str, int | None]:
    """Return by kind the number of messages and earlier samples that the patient received and did not use."""
    return {kind: count_of(logs, "patient", f"{QUARANTINED}.{kind}") for kind in get_args(Kind)}


def quarantine_texts(found: Mapping[str, int | None], cause: str | None = None) -> list[str]:
    """Return a sentence on the messages that the patient's gate did not let through; none without any.

    ``cause`` is why, where it is likely.
    """
    counts = {kind: n for kind, n in found.items() if n}
    kinds = ", ".join(f"{number(n)} {_KINDS.get(kind, kind)}" for kind, n in counts.items())
    n_all = number(sum(counts.values()))
    limits = ", ".join(f"patient.gate.{field}" for kind, field in LIMIT_OF.items() if kind in counts)
    cure = f"if they are right, raise {limits}" if limits else "end the second program that sends as the surgeon"
    cure = "; ".join([*([] if cause is None else [cause]), *([cure] if limits or cause is None else [])])
    return [problem(f"the patient did not use {n_all} samples ({kinds})", cure)] if counts else []


def evidence_summary(logs: RunLogs, scenario: Scenario) -> Evidence:
    """Return the number of contradictions of each kind, null if unknown, and since when; null: never evidence."""
    counters = counters_of(logs, "patient")
    found: dict[str, AlarmFigures] = {}
    for alarm, counter in _COUNTERS.items():
        since_ms = counters.get(f"{SINCE_MS}.{alarm}")
        found[alarm] = AlarmFigures(
            n=counters.get(counter),
            begun_s=None if since_ms is None else since_ms * NS_PER_MS / NS_PER_S,
        )
    return Evidence(on_conflict=scenario.on_conflict, **found)


def evidence_texts(evidence: Evidence) -> Sequence[str]:
    """Return a sentence on each kind of evidence that a run holds; none without any."""
    found, conflict, foreign = [], evidence.conflict, evidence.foreign_set_point
    if conflict.begun_s is not None:
        acts = "the arm held while they came" if evidence.on_conflict == "hold" else "the arm went on"
        found.append(
            f"{conflict.n} samples of the surgeon came in a second version, from {conflict.begun_s:.1f} s on: "
            f"somebody forges them; {acts} (patient.gate.on_conflict)"
        )
    if foreign.n:
        since = "" if foreign.begun_s is None else f", from {foreign.begun_s:.1f} s on"
        found.append(f"somebody else sent {foreign.n} set points for the arms{since}: an arm may have followed them")
    return found


def evidence_problems(evidence: Evidence, scenario: Scenario) -> list[str]:
    """Return a problem where an arm of another program heard set points that the patient did not send."""
    n = evidence.foreign_set_point.n
    if not n or scenario.patient.plant.kind != "external":
        return []
    text = f"evidence.foreign_set_point: the arm heard {n} set points that the patient did not send"
    return [problem(text, "end the other program that publishes on servo_cp")]
