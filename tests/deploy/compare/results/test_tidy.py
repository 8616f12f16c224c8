"""The tidy table against the pooled one: another way to the same figures."""

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.deploy.commands import call
from tis.deploy.compare.engine.compute import Outcome
from tis.deploy.compare.grid import Sweep
from tis.deploy.compare.plan import Request, make_plan
from tis.deploy.compare.results.files import parquet, tidy_rows


def test_its_rows_pool_to_the_tables_figures(small: Path, in_this_process: None) -> None:
    words = ("--sweep", "network.forward.delay.delay_ms=33,200", "--seeds", "2", "--duration-s", "6", "--jobs", "1")
    code, _, err = call("compare", "small.yaml", *words, "--out", "kept")
    assert code == 0
    assert "8 twins, 0.8 min of movement in all, " in err
    table = pq.read_table("kept/cells.parquet")
    rows: list[dict[str, Any]] = table.to_pylist()
    assert len(rows) == 8 * 2
    assert {row["person"] for row in rows} == {"S", "T"}
    report = json.loads(Path("kept/table.json").read_text())
    for pooled in report["rows"]:
        own = [
            row
            for row in rows
            if row["estimator"] == pooled["estimator"]
            and row["network.forward.delay.delay_ms"] == float(pooled["setting"])
        ]
        n = np.array([row["n_scored"] for row in own])
        squares = n * np.array([row["rmse_3d_mm"] for row in own]) ** 2
        assert n.sum() == pooled["n_scored"]
        assert np.sqrt(squares.sum() / n.sum()) == pytest.approx(pooled["rmse_3d_mm"], rel=1e-9)
    assert Path("kept/curves.pdf").read_bytes().startswith(b"%PDF")
    assert Path("kept/ratio.tex").read_text().startswith("% tis")


def test_a_field_with_numbers_and_words_is_text(small: Path) -> None:
    plan = make_plan(Request(str(small), sweeps=(Sweep("source.start", ("auto", "250")),), duration_s=4.0))
    hand = {"n_scored": 0, "age_sum_ns": 0, "estimators": {}}
    outcome = Outcome(cells={cell.digest: {"seed": 1, "hands": {"left": hand}} for cell in plan.cells})
    assert tidy_rows(plan, outcome) == []
    sums: dict[str, Any] = {"sse_m2": [0.0] * 3, "n_missing": 0}
    hand |= {"estimators": {"hold": sums}, "sst_m2": [0.0] * 3, "range_m": [1.0] * 3}
    rows = tidy_rows(plan, outcome)
    assert {row["source.start"] for row in rows} == {"auto", "250"}
    assert {row["age_mean_ms"] for row in rows} == {row["ratio_to_hold"] for row in rows} == {None}
    assert len(pq.read_table(io.BytesIO(parquet(rows)))) == len(rows) == 4
