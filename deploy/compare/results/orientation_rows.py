"""Rows of a comparison for the orientation methods: errors in degrees beside hold's, per setting and method."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, get_args

import numpy as np

from tis.common.scenario.patient import OrientationMethod
from tis.common.units import NS_PER_US
from tis.deploy.compare.cells.sums import merged, percentile
from tis.deploy.compare.results.pooled import interval, resampled
from tis.patient_side.linear_system import Array

HandSums = Sequence[Mapping[str, Any]]


class _WristSums(NamedTuple):
    n: Array
    n_gripper: Array
    sse_rad2: Array
    hold_rad2: Array
    sse_gripper_rad2: Array
    hold_gripper_rad2: Array


class _WristScores(NamedTuple):
    rms_deg: Array
    ratio_to_hold: Array
    gripper_rms_rad: Array
    gripper_ratio_to_hold: Array


def orientation_rows(about: Mapping[str, Any], by_person: Sequence[HandSums]) -> list[dict[str, Any]]:
    """Return a row for each method of one setting, pooled over people, with 95 % bootstrap intervals over people.

    ``about`` begins each row. A method that a hand lacks, as its model has nothing for it, has no row; without a hand
    that turns or whose gripper moves there is none. What no hand does has no scores. Pooling and
    resampling are those of `tis.deploy.compare.results.pooled.pooled`. Oracle: `test_orientation_rows`.
    """
    everything = [hand["orientation"] for hands in by_person for hand in hands]
    scored = any(sums["n_scored"] or sums["n_gripper_scored"] for entry in everything for sums in entry.values())
    methods = get_args(OrientationMethod) if scored else ()
    names = [name for name in methods if all(name in entry for entry in everything)]
    return [{**about, "method": name, **_wrist_row(by_person, everything, name)} for name in names]


def _wrist_row(by_person: Sequence[HandSums], everything: Sequence[Mapping[str, Any]], name: str) -> dict[str, Any]:
    each = [_wrist_sums(hands, name) for hands in by_person]
    stacked = _WristSums(*(np.stack(column) for column in zip(*each, strict=True)))
    row: dict[str, Any] = {}
    again = None
    if len(each) > 1:
        chosen = resampled(len(each))
        again = _wrist_scores(_WristSums(*(column[chosen].sum(axis=1) for column in stacked)))
    for score, value in _wrist_scores(_WristSums(*(column.sum(axis=0) for column in stacked)))._asdict().items():
        row[score] = float(value) if np.isfinite(value) else None
        row[f"{score}_interval_95"] = None if again is None else interval(getattr(again, score))
    entries = [entry[name] for entry in everything]
    steps = merged(entry["step_ns"] for entry in entries)

    def total(count: str) -> int:
        return sum(int(entry[count]) for entry in entries)

    times = {f"p{p}": percentile(steps, p) for p in (50, 99)}
    return row | {
        "coverage_pct": _share_pct(total("n_covered"), total("n_ellipsoids")),
        "gripper_coverage_pct": _share_pct(total("n_gripper_covered"), total("n_gripper_intervals")),
        "n_scored": total("n_scored"),
        "n_missing": total("n_missing"),
        "n_people": len(by_person),
        "step_us": {p: None if ns is None else ns / NS_PER_US for p, ns in times.items()},
    }


def _wrist_sums(hands: HandSums, name: str) -> _WristSums:
    found = [(hand["orientation"][name], hand["orientation"]["hold"]) for hand in hands]
    sums = [
        (
            *(one[name] for name in ("n_scored", "n_gripper_scored")),
            *(each[name] for name in ("sse_rad2", "sse_gripper_rad2") for each in (one, hold)),
        )
        for one, hold in found
    ]
    return _WristSums(*np.sum(np.array(sums, dtype=float), axis=0))


def _wrist_scores(sums: _WristSums) -> _WristScores:
    with np.errstate(divide="ignore", invalid="ignore"):
        return _WristScores(
            np.degrees(np.sqrt(sums.sse_rad2 / sums.n)),
            np.where(sums.hold_rad2 > 0, np.sqrt(sums.sse_rad2 / sums.hold_rad2), np.nan),
            np.sqrt(sums.sse_gripper_rad2 / sums.n_gripper),
            np.where(sums.hold_gripper_rad2 > 0, np.sqrt(sums.sse_gripper_rad2 / sums.hold_gripper_rad2), np.nan),
        )


def _share_pct(n: int, of: int) -> float | None:
    return 100.0 * n / of if of else None
