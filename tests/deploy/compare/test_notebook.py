"""The notebook on comparisons runs, cell by cell, and pools its rows to the report's figures."""

from pathlib import Path

import pytest

from tests.notebooks import check_form, executed

NOTEBOOK = "compare_in_python.ipynb"


@pytest.mark.slow
def test_the_notebook_runs_and_its_rows_pool_to_the_reports_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_this_process: None, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DURATION_S", "3")
    names = executed(NOTEBOOK)
    result = names["result"]
    assert len(result.rows) == 3 * 4 * 3
    expected = {(row["estimator"], row["setting"]): row["rmse_3d_mm"] for row in result.pooled}
    assert names["rmse_mm"] == pytest.approx(expected, rel=1e-9)
    assert len(names["axes"].lines) == 4
    assert names["page"] in names["files"]
    assert "36 rows in" in capsys.readouterr().out


def test_the_notebook_has_the_form_of_version_4_and_no_outputs() -> None:
    check_form(NOTEBOOK)
