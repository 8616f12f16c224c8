"""The command: a quick comparison on a synthetic population from beginning to end, and what it refuses."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from tests.deploy.commands import call_in_one_line as tis
from tests.markdown_tables import ragged_rows
from tis.deploy.studies.methods import command
from tis.deploy.studies.methods.trials import DEFAULT_METHODS, QUICK, methods_of


@pytest.fixture
def there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_this_process: None, quick_twins: None) -> Path:
    monkeypatch.delenv("TIS_JIGSAWS", raising=False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(command, "_QUICK_SYNTHETIC_S", 7.0)
    monkeypatch.setattr(command, "QUICK", replace(QUICK, duration_s=4.0, n_rounds=1, n_ticks=100))
    return tmp_path


def test_a_quick_comparison_without_recordings_gives_page_tables_and_figures(there: Path) -> None:
    code, _, err = tis("paper", "--methods", "--quick", "--estimators", "moesp_kf", "--jobs", "1")
    assert code == 0, err
    page = (there / "runs" / "methods.md").read_text("utf-8")
    assert "a synthetic population, as no recordings were there: 12 trials of Suturing by 4 people" in page
    assert "tis paper --methods --seed 7 --estimators hold,moesp_kf --quick" in page
    assert ragged_rows(page) == []
    folder = there / "runs" / "methods"
    report = json.loads((folder / "methods.json").read_text("utf-8"))
    hold, moesp = report["methods"]
    assert [entry["ratio_to_hold"] for entry in hold["accuracy"]] == [1.0, 1.0]
    assert not moesp["gaps"]
    assert all(entry["ratio_to_hold"] < 1 for entry in moesp["accuracy"])
    assert [entry["n_trials"] for entry in moesp["data"]] == ["1", "all"]
    assert moesp["exponents"]["train_rows"] is not None
    assert moesp["step"]["p50_us"] > 0
    assert "**Training Time**: The paper: *Minimal*. All training trials take `moesp_kf`" in page
    assert (there / "runs" / "methods_figures" / "accuracy.svg").read_bytes() == (
        folder / "accuracy.svg"
    ).read_bytes()
    assert "](methods_figures/accuracy.svg)" in page
    for name in ("methods.csv", "methods.tex", "accuracy.svg", "steps.pdf"):
        assert (folder / name).stat().st_size > 500


def test_unknown_and_own_estimators_are_refused_all_at_once(there: Path) -> None:
    code, _, err = tis("paper", "--methods", "--estimators", "moesp,my_filter:Best")
    assert code == 2
    assert "tis paper --methods: --estimators: no such estimator, did you mean" in err
    assert "must be a built-in estimator (got 'my_filter:Best')" in err
    assert not (there / "runs").exists() or not list((there / "runs").iterdir())


def test_estimators_belong_to_methods(there: Path) -> None:
    code, _, err = tis("paper", "--estimators", "moesp_kf")
    assert (code, "must be given with --methods" in err) == (2, True)


def test_hold_comes_first_and_the_default_has_the_papers_method() -> None:
    assert methods_of("arx_kf, hold,arx_kf") == ("hold", "arx_kf")
    assert methods_of(None) == DEFAULT_METHODS
    assert {"hold", "moesp_kf", "paper"} <= set(DEFAULT_METHODS)
