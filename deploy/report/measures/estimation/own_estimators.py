"""The summary's ``own_estimators``: origin and failures of user-defined estimators."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict
from typing import Any, Final

from tis.common.records import COUNTERS, ESTIMATOR_FAULTS, FAULTY_STEPS
from tis.common.scenario import Scenario
from tis.common.scenario.estimator_names import is_user_defined
from tis.common.units import NS_PER_S
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.recorded import origins_in

_UNKNOWN: Final[Mapping[str, Any]] = {
    "file": None,
    "sha256": None,
    "beside": {},
    "distribution": None,
    "version": None,
}


def own_estimators(logs: RunLogs, scenario: Scenario) -> dict[str, Any]:
    """Return each estimator's origin, ``faulty_steps`` of all hands, and ``first_fault``.

    ``faulty_steps`` is None when the log lost its counters; ``first_fault`` has ``at_s``, ``hand`` and ``reason``, or
    is None without a fault. Oracle: an estimator that fails at known ticks, test_own_estimator.
    """
    names = [name for name in scenario.estimators if is_user_defined(name)]
    if not names:
        return {}
    origins = origins_in(logs)
    counters = {row["name"]: row["value"] for row in logs.of("patient", COUNTERS)}
    first: dict[str, dict[str, Any]] = {}
    for row in sorted(logs.of("patient", ESTIMATOR_FAULTS), key=lambda row: int(row["t_ns"])):
        about = {"at_s": row["t_ns"] / NS_PER_S, "hand": row["hand"], "reason": row["reason"]}
        first.setdefault(row["estimator"], about)
    return {
        name: {
            **(asdict(origins[name]) if name in origins else _UNKNOWN),
            "faulty_steps": counters.get(f"{FAULTY_STEPS}.{name}"),
            "first_fault": first.get(name),
        }
        for name in names
    }


def mark_failed(own: Mapping[str, Any], each: Iterable[dict[str, Any]]) -> None:
    """Set ``failed`` in the scores of each user-defined estimator, in each of several tables of scores."""
    for scores in each:
        for name, about in own.items():
            if name in scores:
                scores[name]["failed"] = _failed(about)


def labelled(name: str, entry: Mapping[str, Any]) -> str:
    """Return an estimator's name for tables, with a star if it failed."""
    return f"{name} *" if entry.get("failed") else name


def _failed(about: Mapping[str, Any]) -> bool:
    return about["first_fault"] is not None or bool(about["faulty_steps"])


def estimator_fault_texts(summary: Mapping[str, Any]) -> list[str]:
    """Return a line for each estimator that failed; the other figures of the run stay valid."""
    texts = []
    for name, about in summary.get("own_estimators", {}).items():
        first, n_steps = about["first_fault"], about["faulty_steps"]
        if not _failed(about):
            continue
        times = "at times" if n_steps is None else f"in {n_steps} step{'s' if n_steps > 1 else ''}"
        text = f"* {name} failed {times}: no estimate there, where hold's is scored in its place"
        if first is not None:
            text += f"; first at {first['at_s']:.3f} s, {first['hand']} hand: {first['reason']}"
        texts.append(text)
    return texts
