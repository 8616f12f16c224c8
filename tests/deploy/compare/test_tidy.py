"""The tidy table against the pooled one: another way to the same figures."""

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from deploy.compare.tidy import parquet
from tests.deploy.commands import call


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
    assert Path("kept/ratio.pdf").read_bytes().startswith(b"%PDF")
    assert Path("kept/ratio.tex").read_text().startswith("% tis ")


def test_a_field_with_numbers_and_words_is_text() -> None:
    rows: list[dict[str, Any]] = [{"a": 1.0, "b": None}, {"a": "auto", "b": 2.0}]
    table = pq.read_table(io.BytesIO(parquet(rows)))
    assert table.to_pylist() == [{"a": "1.0", "b": None}, {"a": "auto", "b": 2.0}]
