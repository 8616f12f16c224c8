"""Report of `tis compare --definitions` as plain values: our figures by reading, beside the published ones."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from tis.deploy.compare.cells.error_sums import ErrorSums
from tis.deploy.compare.definitions.published import PUBLISHED, Published
from tis.deploy.compare.definitions.readings import HORIZONS_S, READINGS, Reading, value_mm
from tis.deploy.compare.definitions.splits import NAMES, SPLITS
from tis.deploy.compare.definitions.velocity_inputs import Inputs
from tis.deploy.compare.engine.compute import Outcome
from tis.deploy.compare.plan import Plan

OURS: Final = NAMES[-1]
_AT_HORIZON: Final = Reading("rmse_3d", "at")


def build(
    plan: Plan, outcome: Outcome, least_squares: Mapping[Inputs, ErrorSums | None], command: str
) -> dict[str, Any]:
    """Return the report: rows of readings, least squares with and without velocities, published figures."""
    rows = _rows(plan, outcome)
    return {
        "command": command,
        "trials": list(plan.trials),
        "people": sorted({trial[0] for trial in plan.trials}),
        "horizons_s": list(HORIZONS_S),
        "rows": rows,
        "least_squares": [
            {"rate_hz": inputs.rate_hz, "velocity": inputs.velocity, "mm": _by_horizon(sums, _AT_HORIZON)}
            for inputs, sums in least_squares.items()
            if sums is not None and sums.n
        ],
        "published": [beside(each, rows) for each in PUBLISHED],
        "missing": [split for split in SPLITS if not any(row["split"] == split for row in rows)],
        "failed": [f"{failure.label}: {failure.reason}" for failure in outcome.failures]
        + [str(fault) for fault in plan.refused],
    }


def _rows(plan: Plan, outcome: Outcome) -> list[dict[str, Any]]:
    """Return a row for each split with forecasts and each reading, numbered from 1."""
    rows: list[dict[str, Any]] = []
    for split in SPLITS:
        found = [outcome.cells[cell.digest] for cell in plan.cells if cell.setting == split
                 and cell.digest in outcome.cells]  # fmt: skip
        sums = {name: _pooled(found, name) for name in NAMES}
        known = {name: each for name, each in sums.items() if each is not None and each.n}
        if len(known) < len(NAMES):
            continue
        rows += [
            {
                "row": len(rows) + number,
                "split": split,
                "error": reading.error,
                "span": reading.span,
                "n_trials": len(found),
                "n_forecasts": known[OURS].n,
                "mm": {name: _by_horizon(each, reading) for name, each in known.items()},
            }
            for number, reading in enumerate(READINGS, start=1)
        ]
    return rows


def _pooled(results: Sequence[Mapping[str, Any]], name: str) -> ErrorSums | None:
    """Return the sums over all twins and both arms."""
    return ErrorSums.total(
        ErrorSums.from_json(by_name[name]) for result in results for by_name in result["forecasts"].values()
    )


def _by_horizon(sums: ErrorSums, reading: Reading) -> list[float]:
    return [value_mm(sums, reading, horizon_s) for horizon_s in HORIZONS_S]


def beside(published: Published, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return a published figure with the rows that its text allows, our range over them, and the verdict."""
    fitting = [
        row
        for row in rows
        if published.mm is not None
        and row["error"] in published.errors
        and row["span"] in published.spans
        and row["split"] in published.splits
    ]
    ours: dict[str, list[float]] = {}
    if fitting and published.horizon_s is not None:
        at = HORIZONS_S.index(published.horizon_s)
        for name in NAMES:
            values = [row["mm"][name][at] for row in fitting]
            ours[name] = [min(values), max(values)]
    return {
        "name": published.name,
        "figure": published.figure,
        "mm": published.mm,
        "horizon_s": published.horizon_s,
        "rows": [row["row"] for row in fitting],
        "ours_mm": ours,
        "verdict": verdict(published, len(fitting)),
        "says": published.says,
        "leaves_open": list(published.leaves_open),
        "citation": published.citation,
        "read": published.read,
    }


def verdict(published: Published, n_fitting: int) -> str:
    """Return ``comparable``, or ``not comparable, because ...``: one reading must be left, and no difference."""
    reasons = list(published.differs)
    if published.mm is not None and n_fitting == 0:
        reasons.append("there is no row of ours that its text allows")
    if published.mm is not None and n_fitting > 1:
        reasons.append(f"the text that was read allows {n_fitting} rows")
    if published.leaves_open:
        reasons.append(f"it leaves open: {', '.join(published.leaves_open)}")
    return "not comparable, because " + "; ".join(reasons) if reasons else "comparable"


def standing(entry: Mapping[str, Any]) -> str:
    """Return where a published figure is relative to the range of ours; empty for one that is no distance.

    Ours are rounded to the published figures' hundredths of a mm: nothing closer can be told.
    """
    if not entry["ours_mm"]:
        return ""
    low, high = (round(mm, 2) for mm in entry["ours_mm"][OURS])
    if entry["mm"] < low:
        return "below the range of"
    return "above the range of" if entry["mm"] > high else "within the range of"
