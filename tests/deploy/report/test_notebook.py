"""The notebook in docs/ runs, cell by cell, and says what the summary says."""

from pathlib import Path
from shutil import copytree

import numpy as np
import pytest

from tests.deploy.logs.conftest import run_dir, scenario
from tests.log_reader import cut
from tests.notebooks import check_form, executed
from tis.deploy.logs.read.load import load_run
from tis.deploy.report import load
from tis.deploy.report.subjects.network.link_summary import link_summary

__all__ = ["run_dir", "scenario"]

NOTEBOOK = "run_in_python.ipynb"


def test_the_notebook_runs_and_its_figures_are_the_summary_s(
    run_dir: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("RUN_DIR", str(run_dir))
    names = executed(NOTEBOOK)
    summary = load(run_dir).summary
    assert summary is not None
    for name, value in names["rmse_mm"].items():
        assert value == pytest.approx(summary["accuracy_by_hand"]["left"][name]["rmse_3d_mm"])
    assert names["loss_pct"] == pytest.approx(summary["links"]["forward"]["loss_pct"])
    assert np.isfinite(names["error_mm"]).any()
    assert "ticks, mean error" in capsys.readouterr().out


@pytest.mark.parametrize("side", ["surgeon", "netem", "patient"])
@pytest.mark.parametrize("is_cut", [True, False])
def test_the_notebook_runs_on_what_is_left_and_counts_no_message_that_is_untold(
    run_dir: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    side: str,
    is_cut: bool,
) -> None:
    """The loss is the one that the summary states of the same logs."""
    left = Path(copytree(run_dir, tmp_path / "r"))
    log = left / f"{side}.mcap"
    cut(log)
    if not is_cut:
        log.unlink()
    monkeypatch.setenv("RUN_DIR", str(left))
    names = executed(NOTEBOOK)
    logs = load_run(left)
    link, _ = link_summary(logs, "forward", load(left).scenario)
    assert (link["untold"] > 0) == is_cut
    if link["loss_pct"] is None:
        assert side == "netem"
        assert "tells of no message" in capsys.readouterr().out
    else:
        assert names["loss_pct"] == pytest.approx(link["loss_pct"])


def test_the_notebook_has_the_form_of_version_4_and_no_outputs() -> None:
    check_form(NOTEBOOK)
