"""The tidy table of a comparison: a row for each cell, hand and estimator, and a column for each swept field.

It is what programs read: pandas, polars or R group its rows as they like.
"""

import io
from collections.abc import Mapping, Sequence
from typing import Any, Final

from tis.common.units import NS_PER_MS, NS_PER_US
from tis.deploy.compare.cells.histogram import percentile
from tis.deploy.compare.engine.compute import Outcome
from tis.deploy.compare.plan import Plan
from tis.deploy.compare.results.axes import numbers_of
from tis.deploy.compare.results.people import person
from tis.deploy.compare.results.pooled import pooled

FILE: Final = "cells.parquet"


def tidy_rows(plan: Plan, outcome: Outcome) -> list[dict[str, Any]]:
    """Return the rows in the order of the plan; what is unknown is None."""
    # A field is a number where all of its values are.
    are_numbers = {path: numbers_of(point.values[path] for point in plan.points) is not None for path in plan.axes}
    at_of = {
        point.label: {path: float(value) if are_numbers[path] else value for path, value in point.values.items()}
        for point in plan.points
    }
    rows = []
    for cell in plan.cells:
        result = outcome.cells.get(cell.digest)
        if result is None:
            continue
        about = {**at_of[cell.setting], "trial": cell.trial, "person": person(cell), "seed": result["seed"]}
        for hand, entry in result["hands"].items():
            n = entry["n_scored"]
            age_ms = entry["age_sum_ns"] / NS_PER_MS / n if n else None
            of_hand = {**about, "hand": hand, "age_mean_ms": age_ms}
            rows += [{**of_hand, "estimator": name, **_scores(entry, name)} for name in entry["estimators"]]
    return rows


def arrow(rows: Sequence[Mapping[str, Any]]) -> Any:
    """Return the rows as a `pyarrow.Table`; needs pyarrow."""
    import pyarrow as pa

    return pa.table({name: [row[name] for row in rows] for name in rows[0]} if rows else {})


def parquet(rows: Sequence[Mapping[str, Any]]) -> bytes:
    """Return the rows as a Parquet file; needs pyarrow."""
    import pyarrow.parquet as pq

    buffer = io.BytesIO()
    pq.write_table(arrow(rows), buffer, compression="zstd")
    return buffer.getvalue()


def _scores(entry: dict[str, Any], name: str) -> dict[str, Any]:
    """Return the scores of one estimator in one cell, those of each axis as columns of their own."""
    found, median_ns = pooled([[entry]], name), percentile(entry["estimators"][name].get("step_ns", {}), 50)
    of_axes = {
        f"{score}_{axis}": value
        for score in ("r2_pct", "rmse_mm")
        for axis, value in zip("xyz", found[score], strict=True)
    }
    return {
        "n_scored": found["n_scored"],
        "n_missing": found["n_missing"],
        **of_axes,
        **{score: found[score] for score in ("rmse_3d_mm", "ratio_to_hold", "coverage_pct")},
        "step_us": None if median_ns is None else median_ns / NS_PER_US,
    }
