"""A made-up outcome of a real plan: cells with drawn sums, of any number."""

from typing import Any

import numpy as np

from tis.deploy.compare.cells.sums import AGE_EDGES_MS
from tis.deploy.compare.engine.compute import Outcome
from tis.deploy.compare.plan import Plan

N_BINS = len(AGE_EDGES_MS)
AGES_NS = 1e6 * (np.array(AGE_EDGES_MS) + 2)
"""A tick's age in each bin: 2 ms above its lower edge."""


def outcome_of(plan: Plan, hands: tuple[str, ...] = ("left", "right")) -> Outcome:
    """Return drawn sums of each cell of a plan; the first hand of the first cell has no scored tick."""
    draw = np.random.default_rng(3)
    cells = {}
    for i, cell in enumerate(plan.cells):
        found = {}
        for hand in hands:
            n_by_age = np.zeros(N_BINS) if (i, hand) == (0, hands[0]) else draw.integers(0, 3, N_BINS)
            n = int(n_by_age.sum())
            found[hand] = {
                "n_scored": n,
                "sst_m2": (1e-3 * draw.random(3) * n).tolist(),
                "range_m": [0.1, 0.1, 0.1],
                "n_by_age": n_by_age.tolist(),
                "age_sum_by_age_ns": (n_by_age * AGES_NS).tolist(),
                "age_sum_ns": n * 35_000_000,
                "age_ns": {"17379": n} if n else {},
                "orientation": {},
                "estimators": {name: _sums(draw, n_by_age, name) for name in plan.estimators},
            }
        traffic = {"sent_packets": 60, "sent_bytes": 6000}
        cells[cell.digest] = {
            "seed": cell.scenario.seed, "trial": cell.trial, "traffic": traffic, "duration_s": 2.0, "hands": found,
            "warnings": [], "unscored": None,
        }  # fmt: skip
    return Outcome({}, cells)


def _sums(draw: np.random.Generator, n_by_age: Any, name: str) -> dict[str, Any]:
    n = int(n_by_age.sum())
    sums = {
        "sse_m2": (1e-5 * draw.random(3) * n).tolist(),
        "n_missing": int(draw.integers(0, 3)),
        "sse_by_age_m2": (1e-5 * draw.random(N_BINS) * n_by_age).tolist(),
        "step_ns": {"900": 7},
        "error_nm": {"1400": n},
    }
    return sums if name == "hold" else sums | {"n_covered": n // 2, "n_ellipsoids": n, "trained": True}
