"""Refused connections and messages of a run, by kind: by netem's routers, and by the sides."""

from collections.abc import Mapping
from typing import Final, get_args

from tis.common.channels import Side
from tis.common.records import COUNTERS
from tis.common.refusal import MEANING, REFUSED, Refusal
from tis.deploy.logs.read.load import RunLogs

OTHER_RUN: Final = "other_run"
CONFLICTING: Final = "conflicting"
_OF_SIDES: Final[Mapping[str, tuple[str, tuple[Side, ...]]]] = {
    OTHER_RUN: ("a message of another run", ("surgeon", "patient")),
    CONFLICTING: ("a second content under one sequence number", ("surgeon",)),  # the patient's are quarantined
}


def refused(logs: RunLogs) -> dict[str, int | None]:
    """Return the number of refusals by kind; None where a log that counts them is missing or ended early."""
    counts: dict[str, int | None] = {kind: _count(logs, "netem", f"{REFUSED}.{kind}") for kind in get_args(Refusal)}
    for kind, (_, sides) in _OF_SIDES.items():
        found = [_count(logs, side, kind) for side in sides]
        counts[kind] = None if None in found else sum(n or 0 for n in found)
    return counts


def refusal_texts(counts: Mapping[str, int | None]) -> list[str]:
    """Return a sentence on what was refused; none without any."""
    words: dict[str, str] = dict(MEANING.items()) | {kind: text for kind, (text, _) in _OF_SIDES.items()}
    found = [f"{words.get(kind, kind)}{f' ({n} times)' if n > 1 else ''}" for kind, n in counts.items() if n]
    return [f"refused: {'; '.join(found)}"] if found else []


def _count(logs: RunLogs, side: Side, name: str) -> int | None:
    """Return a counter that is only written when it is above 0; None without any counters."""
    log = logs.sides.get(side)
    rows = {} if log is None else {row["name"]: row["value"] for row in log.of(COUNTERS)}
    return int(rows.get(name, 0)) if rows else None
