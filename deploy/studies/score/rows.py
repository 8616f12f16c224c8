"""A row of the scoreboard: what a score says of an estimator, from the sums of its twins."""

import os
import platform
import re
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import Any, Final

import numpy as np

from tis.common.units import NS_PER_US
from tis.deploy.compare.cells.identity import software_digest
from tis.deploy.compare.cells.sums import merged, percentile
from tis.deploy.compare.engine.compute import Outcome
from tis.deploy.compare.results.pooled import interval, person, pooled, resampled, sums_of
from tis.deploy.studies.score import foreign, reference
from tis.deploy.studies.score.plan import Asked, Subject, Work
from tis.deploy.studies.score.protocol import content, digest

_LIBRARIES: Final = ("tis-testbed", "numpy", "scipy", "filterpy")
_PLACE: Final = re.compile(r"ForeignFault: | \(foreign\.py, line \d+\)$")
_DIGITS: Final = {"ratio_to_hold": 3, "rmse_3d_mm": 3, "coverage_pct": 1}

Hands = list[dict[str, Any]]
Row = dict[str, Any]
People = Mapping[str, Hands]


def row_of(subject: Subject, asked: Asked, work: Work, outcome: Outcome, seconds: float) -> Row:
    """Return the row of an estimator; one that failed has a reason in place of scores.

    Only ``machine`` depends on the machine, the other processes and the clock: all else is the same when repeated.
    """
    reason = why_failed(subject, work, outcome)
    own = work.own.get(subject.scenario_name)
    code = foreign.digest_of_files(subject.command) if subject.command else own.origin.sha256 if own else None
    if reason is not None:
        return failed_row(subject, asked, reason, code, seconds)
    settings = by_setting(work, outcome)
    scored = {name: _scores(people, subject.scenario_name) for name, people in settings.items()}
    score, bounds = overall(settings, subject.scenario_name)
    hands = [hand for people in settings.values() for entries in people.values() for hand in entries]
    entries = [hand["estimators"][subject.scenario_name] for hand in hands]
    known = sum(entry["n_ellipsoids"] for entry in entries)
    return _head(subject, asked, code) | {
        "score": score,
        "score_interval_95": bounds,
        "coverage_pct": round(100 * sum(entry["n_covered"] for entry in entries) / known, 1) if known else None,
        "n_people": len(next(iter(settings.values()))),
        "n_missing": sum(entry["n_missing"] for entry in entries),
        "settings": scored,
        "machine": _machine(seconds) | _cost(subject, hands),
    }


def failed_row(subject: Subject, asked: Asked, reason: str, code: str | None = None, seconds: float = 0.0) -> Row:
    """Return the row of an estimator that has no scores, but a reason."""
    return _head(subject, asked, code) | {"failed": reason, "machine": _machine(seconds)}


def _head(subject: Subject, asked: Asked, code: str | None) -> Row:
    return {
        "estimator": subject.name,
        "protocol": f"v{content()['version']}",
        "protocol_sha256": digest(),
        "track": asked.track,
        "quick": asked.quick,
        "seed": asked.seed,
        "code": code,
    }


def why_failed(subject: Subject, work: Work, outcome: Outcome) -> str | None:
    """Return why an estimator has no row: it never answered, or its process broke the protocol once."""
    name = subject.scenario_name
    for cell in work.cells:
        result = outcome.cells[cell.digest]
        fault = result.get("own_faults", {}).get(name)
        if fault is not None and subject.command:
            return f"{cell.setting}: {result['trial']}, {_PLACE.sub('', fault['first'])}"
    return outcome.without_answer().get(name)


def by_setting(work: Work, outcome: Outcome) -> Mapping[str, People]:
    """Return the sums of the hands of each person, by setting."""
    found: dict[str, dict[str, Hands]] = {}
    for cell in work.cells:
        hands = outcome.cells[cell.digest]["hands"].values()
        found.setdefault(str(cell.setting), {}).setdefault(person(cell), []).extend(hands)
    return found


def overall(settings: Mapping[str, People], name: str) -> tuple[float, list[float]]:
    """Return the geometric mean of the settings' ratios to hold, and its 95 % interval over people.

    Of each resample the same people count in all settings. Oracle: a loop over resamples, test_rows.
    """
    logs = []
    again = []
    for people in settings.values():
        each = [sums_of(hands, name) for hands in people.values()]
        own = np.array([sums.sse.sum() for sums in each])
        held = np.array([sums.hold_sse.sum() for sums in each])
        chosen = resampled(len(people))
        logs.append(0.5 * np.log(own.sum() / held.sum()))
        again.append(0.5 * np.log(own[chosen].sum(axis=1) / held[chosen].sum(axis=1)))
    low, high = interval(np.exp(np.mean(again, axis=0)))
    return round(float(np.exp(np.mean(logs))), 3), [round(low, 3), round(high, 3)]


def _scores(people: People, name: str) -> dict[str, Any]:
    found = pooled(list(people.values()), name)
    row: dict[str, Any] = {}
    for score, digits in _DIGITS.items():
        row[score] = _rounded(found[score], digits)
        bounds = found[f"{score}_interval_95"]
        row[f"{score}_interval_95"] = None if bounds is None else [_rounded(bound, digits) for bound in bounds]
    return row | {"n_scored": found["n_scored"], "n_missing": found["n_missing"]}


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)


def _cost(subject: Subject, hands: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the median time of a step, and how often the reference loop of the same twins fits into it."""

    def median_us(name: str) -> float:
        steps = merged(hand["estimators"][name]["step_ns"] for hand in hands)
        return (percentile(steps, 50) or 0.0) / NS_PER_US

    own, loop = median_us(subject.scenario_name), median_us(reference.NAME)
    return {
        "step_ratio": float(f"{own / loop:.3g}"),
        "step_us": float(f"{own:.3g}"),
        "reference_us": float(f"{loop:.3g}"),
        "timed_by": "the clock" if subject.command else "processor time",
    }


def _machine(seconds: float) -> dict[str, Any]:
    return {
        "seconds": round(seconds, 1),
        "cores": os.cpu_count(),
        "processor": platform.machine(),
        "python": platform.python_version(),
        "versions": {name: version(name) for name in _LIBRARIES},
        "software": software_digest(),
    }
