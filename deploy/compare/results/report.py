"""Rows of a comparison's report from the cells' sums: per setting and estimator, and per trial."""

from collections.abc import Iterable, Mapping, Sequence
from math import isfinite
from typing import Any, Final

from tis.common.runtime.scenario_files import load_traces
from tis.common.scenario.estimator_names import is_user_defined
from tis.common.sources.table_columns import in_few
from tis.common.units import NM_PER_MM, NS_PER_MS, NS_PER_US
from tis.deploy.compare.cells.cell import Cell
from tis.deploy.compare.cells.sums import AGE_EDGES_MS, ERROR_WIDTH, merged, percentile
from tis.deploy.compare.engine.compute import Outcome
from tis.deploy.compare.grid import Point
from tis.deploy.compare.plan import Plan
from tis.deploy.compare.results.felt_and_seen import felt_and_seen_row
from tis.deploy.compare.results.orientation_rows import orientation_rows
from tis.deploy.compare.results.pooled import person, pooled, rivalries
from tis.deploy.present.numbers import number
from tis.deploy.report.subjects.accuracy import MAX_WITHOUT_ESTIMATE
from tis.netem.expected.synopsis import synopsis

# Axes of a comparison whose values are numbers: these can be drawn to scale and stored as numbers.


def numbers_of(values: Iterable[str]) -> list[float] | None:
    """Return the values of an axis as numbers; None where one of them is not a finite number."""
    try:
        numbers = [float(value) for value in values]
    except ValueError:
        return None
    return numbers if all(map(isfinite, numbers)) else None


def numeric_axes(report: dict[str, Any]) -> list[str]:
    """Return the axes of a report that have at least two values, all of which are numbers."""
    found = []
    for path in report["axes"]:
        values = {about["at"][path] for about in report["settings"] if about["n_cells"]}
        if len(values) > 1 and numbers_of(values) is not None:
            found.append(path)
    return found


def labels(report: Mapping[str, Any]) -> dict[str, str]:
    """Return each scored estimator's name for tables and figures, with a star if `is_starred`."""
    starred = {row["estimator"] for row in report["rows"] if is_starred(row)}
    return {name: f"{name} *" if name in starred else name for name in (row["estimator"] for row in report["rows"])}


def is_starred(row: Mapping[str, Any]) -> bool:
    """Tell whether an estimator failed in some step, or one of the user's often gave no estimate."""
    return bool(row.get("faulty_steps")) or _is_silent(row)


def _is_silent(row: Mapping[str, Any]) -> bool:
    is_often = row.get("n_missing", 0) > MAX_WITHOUT_ESTIMATE * row.get("n_scored", 0)
    return is_often and is_user_defined(row["estimator"])


def star_note(report: Mapping[str, Any]) -> str:
    """Return what the star of `labels` means; "" without one."""
    text = "* failed, or gave no estimate, at some ticks, where hold's is scored in its place"
    return text if any(map(is_starred, report["rows"])) else ""


Hands = list[dict[str, Any]]

ERROR_PERCENTS: Final = (50, 95, 99, 100)
"""Percentiles of the distance to the truth; 100 is the largest one."""


def report(plan: Plan, outcome: Outcome, command: str) -> dict[str, Any]:
    """Return the comparison as JSON: request, ``rows``, ``by_trial``, age and traffic, and failures."""
    cells: dict[str | None, list[Cell]] = {}
    for cell in plan.cells:
        cells.setdefault(cell.setting, []).append(cell)
    settings = [_setting(plan, outcome, point, cells.get(point.label, [])) for point in plan.points]
    rows = [row for setting in settings for row in setting["rows"]]
    results = [*outcome.trainings.values(), *outcome.cells.values()]
    warnings = [*(text for result in results for text in result["warnings"]), *_slow(plan, rows)]
    scored = {row["trial"] for setting in settings for row in setting["by_trial"] if row["n_scored"]}
    return {
        "scenario": plan.name,
        "command": command,
        "source": plan.source,
        "synthetic": [trial for trial in plan.synthetic if trial in scored],
        "trained_on": plan.trained_on,
        "network": _network(plan),
        "sweep": ", ".join(plan.axes) or None,
        "axes": list(plan.axes),
        "zipped": plan.zipped,
        "trials": [trial for trial in plan.trials if trial in scored],
        "n_trials_asked": len(plan.trials),
        "n_seeds": plan.n_seeds,
        "n_cells": len(plan.cells),
        "n_computed": len(outcome.cells),
        "n_resumed": outcome.n_resumed,
        "rows": rows,
        "by_trial": [row for setting in settings for row in setting["by_trial"]],
        "orientation": [row for setting in settings for row in setting["orientation"]],
        "touch_and_sight": [row for setting in settings if (row := setting["touch_and_sight"]) is not None],
        "settings": [setting["about"] for setting in settings],
        "failed": [f"{failure.label}: {failure.reason}" for failure in outcome.failures]
        + [f"{name}: {text}" for name, text in outcome.without_answer().items()]
        + [str(fault) for fault in plan.refused],
        "unscored": _unscored(plan, outcome),
        "topologies": sorted({cell.scenario.topology for cell in plan.cells}),
        "warnings": list(dict.fromkeys(warnings)),
        "own_faults": [*_own_faults(outcome), *_silent(rows)],
    }


def _network(plan: Plan) -> list[str]:
    """Return the network in words, one line per direction; of several that of the first setting, and what differs."""
    if not plan.cells:
        return []
    network, first = plan.cells[0].scenario.network, plan.cells[0].setting
    is_one = all(cell.scenario.network == network for cell in plan.cells)
    at = "" if is_one or first is None else f"at {first}, "
    lines = [f"{at}{line}" for line in synopsis(network, load_traces(network))]
    for path in plan.axes if at else ():
        values = list(dict.fromkeys(point.values[path] for point in plan.points))
        if path.startswith("network") and len(values) > 1:
            lines.append(f"other settings differ in {path}: {in_few(values)}")
    return lines


def _setting(plan: Plan, outcome: Outcome, point: Point, cells: Sequence[Cell]) -> dict[str, Any]:
    value, at = point.label, {"at": point.values} if point.values else {}
    found = [(cell, outcome.cells[cell.digest]) for cell in cells if cell.digest in outcome.cells]
    found = [(cell, result) for cell, result in found if not _is_set_aside(result)]
    if not found:
        nothing = {"setting": value, **at, "n_cells": 0}
        return {"rows": [], "by_trial": [], "orientation": [], "touch_and_sight": None, "about": nothing}
    names = [name for name in plan.estimators if all(_has(result, name) for _, result in found)]
    own = {name for _, result in found for name in result.get("own_faults", {})}
    # hands pooled in four ways: all, by person, by trial, by hand
    by_person: dict[str, Hands] = {}
    by_trial: dict[str, Hands] = {}
    by_hand: dict[str, Hands] = {}
    for cell, result in found:
        by_person.setdefault(person(cell), []).extend(result["hands"].values())
        by_trial.setdefault(cell.trial, []).extend(result["hands"].values())
        for hand, entry in result["hands"].items():
            by_hand.setdefault(hand, []).append(entry)
    everything = [entry for entries in by_trial.values() for entry in entries]
    train_s: dict[str, float] = {}
    for digest in plan.trainings:
        train_s |= outcome.trainings.get(digest, {}).get("train_s", {})
    rows = []
    for name in names:
        entries = [entry["estimators"][name] for entry in everything]
        steps = merged(entry.get("step_ns", {}) for entry in entries)
        errors = merged(entry["error_nm"] for entry in entries)
        rows.append(
            {
                "setting": value,
                **at,
                "estimator": name,
                **pooled(list(by_person.values()), name),
                "n_trials": len(by_trial),
                "step_us": {f"p{p}": _scaled(percentile(steps, p), NS_PER_US) for p in (50, 99)},
                "error_mm": {f"p{p}": _scaled(percentile(errors, p, ERROR_WIDTH), NM_PER_MM) for p in ERROR_PERCENTS},
                "train_s": train_s.get(name) if entries[0].get("trained") else None,
                "faulty_steps": sum(_faulty_steps(result, name) for _, result in found),
                "by_hand": {hand: _short(pooled([hands], name)) for hand, hands in by_hand.items()},
                "rmse_by_age_mm": _by_age(everything, name),
            }
        )
    ranked = rivalries(list(by_person.values()), names) if names else {}
    rows = [row | ranked[row["estimator"]] for row in rows]
    trials = [
        {"setting": value, **at, "trial": trial, "estimator": name, **_short(pooled([hands], name))}
        for trial, hands in by_trial.items()
        for name in names
    ]
    return {
        "rows": rows,
        "by_trial": trials,
        "orientation": orientation_rows({"setting": value, **at}, list(by_person.values())),
        "touch_and_sight": felt_and_seen_row({"setting": value, **at}, [result for _, result in found]),
        "about": _about(value, found, everything)
        | {"failed": [name for name in plan.estimators if name in own.difference(names)]}
        | at,
    }


def _about(value: str | None, found: Sequence[tuple[Cell, Mapping[str, Any]]], hands: Hands) -> dict[str, Any]:
    """Return age and traffic of a setting."""
    ages = merged(hand["age_ns"] for hand in hands)
    n_ticks = sum(hand["n_scored"] for hand in hands)
    seconds = sum(result["duration_s"] for _, result in found)
    sent = {name: sum(result["traffic"][name] for _, result in found) for name in found[0][1]["traffic"]}
    return {
        "setting": value,
        "n_cells": len(found),
        "age_ms": {
            "mean": sum(hand["age_sum_ns"] for hand in hands) / NS_PER_MS / n_ticks if n_ticks else None,
            **{f"p{p}": _scaled(percentile(ages, p), NS_PER_MS) for p in (50, 99)},
        },
        "packets_per_s": sent["sent_packets"] / seconds,
        "bytes_per_s": sent["sent_bytes"] / seconds,
    }


def _by_age(hands: Hands, name: str) -> list[dict[str, Any]]:
    """Return the 3D error of each non-empty bin of age."""
    rows = []
    for i, low_ms in enumerate(AGE_EDGES_MS):
        n = sum(hand["n_by_age"][i] for hand in hands)
        if n:
            squares = sum(hand["estimators"][name]["sse_by_age_m2"][i] for hand in hands)
            age_ms = sum(hand["age_sum_by_age_ns"][i] for hand in hands) / NS_PER_MS / n
            error_mm = 1000 * (squares / n) ** 0.5
            rows.append({"from_ms": low_ms, "age_mean_ms": age_ms, "n": n, "rmse_3d_mm": error_mm})
    return rows


def _has(result: Mapping[str, Any], name: str) -> bool:
    return all(name in hand["estimators"] for hand in result["hands"].values())


def _faulty_steps(result: Mapping[str, Any], name: str) -> int:
    return int(result.get("own_faults", {}).get(name, {}).get("n_faults", 0))


def _short(scores: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in scores.items() if not name.endswith("_interval_95") and name != "n_people"}


def _scaled(value: float | None, unit: int) -> float | None:
    return None if value is None else value / unit


def _is_set_aside(result: dict[str, Any]) -> bool:
    """Tell whether a cell has scored ticks that are no measurement: its patient left samples unused."""
    return result.get("unscored") is not None and any(hand["n_scored"] for hand in result["hands"].values())


def _unscored(plan: Plan, outcome: Outcome) -> list[str]:
    """Return the cells without a valid score, each with the reason."""
    found = {cell.label: outcome.cells[cell.digest] for cell in plan.cells if cell.digest in outcome.cells}
    return [
        f"{label}: {'not a valid measurement' if _is_set_aside(result) else 'no tick could be scored'}: "
        f"{result['unscored']}"
        for label, result in found.items()
        if result.get("unscored") is not None
    ]


def _slow(plan: Plan, rows: Sequence[Mapping[str, Any]]) -> Iterable[str]:
    """Yield a warning of each estimator whose step takes longer than a tick: a live run would miss ticks."""
    rates_hz = {cell.setting: cell.scenario.rate_hz for cell in plan.cells}
    told: set[str] = set()
    for row in rows:
        name, step_us, tick_ms = row["estimator"], row["step_us"]["p50"], 1000 / rates_hz[row["setting"]]
        if step_us is not None and step_us > 1000 * tick_ms and name not in told:
            told.add(name)
            takes, lasts = number(step_us / 1000), number(tick_ms)
            yield f"{name} takes {takes} ms a step at the median, a tick lasts {lasts} ms: live it would miss ticks"


def _silent(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return a line for each estimator of the user's that did not fail, and yet often gave no estimate."""
    counts: dict[str, list[int]] = {}
    for row in rows:
        found = counts.setdefault(row["estimator"], [0, 0, 0])
        for i, name in enumerate(("n_missing", "n_scored", "faulty_steps")):
            found[i] += row[name]
    often = {row["estimator"] for row in rows if _is_silent(row)}
    return [
        f"* {name} gave no estimate at {n} of {of} scored ticks, where hold's is scored in its place"
        for name, (n, of, n_faults) in counts.items()
        if name in often and not n_faults
    ]


def _own_faults(outcome: Outcome) -> list[str]:
    """Return a line for each user-defined estimator that failed, over all cells."""
    counts: dict[str, list[int]] = {}
    first: dict[str, str] = {}
    for result in outcome.cells.values():
        for name, about in result.get("own_faults", {}).items():
            if not _has(result, name):
                continue
            found = counts.setdefault(name, [0, 0])
            found[0] += about["n_faults"]
            found[1] += about["n_steps"]
            first.setdefault(name, f"{result['trial']}, seed {result['seed']}, at {about['first']}")
    return [
        f"* {name} failed in {n} of {n_steps} steps of the twins in which it did: no estimate there, where hold's is "
        f"scored in its place; first: {first[name]}"
        for name, (n, n_steps) in counts.items()
    ]
