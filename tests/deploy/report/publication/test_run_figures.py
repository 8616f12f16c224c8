"""Figures for papers: what is drawn, how wide, and the command that writes them."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from tests.deploy.report.hand_made import a_scenario, estimate, message, truth, write_run
from tests.deploy.report.partial import summary_of
from tis.deploy.cli.main import app
from tis.deploy.logs.read.load import load_run
from tis.deploy.report.command import read_run
from tis.deploy.report.measured_run import MeasuredRun
from tis.deploy.report.publication.run_figures import COLUMN_IN, paper_figures
from tis.deploy.report.run_view import RunView

STARTS = {"svg": b"<?xml", "pdf": b"%PDF", "png": b"\x89PNG"}
NAMES = ("position", "error", "error_by_age", "latency_cdf", "delay", "delay_cdf", "loss_runs")


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("figures") / "run"
    words = ("--duration-s", "8", "--no-report", "--no-merge", "--run-dir", str(path))
    assert (
        CliRunner().invoke(app, ["twin", "default", "--set", "network.forward.loss.p_loss=0.2", *words]).exit_code
        == 0
    )
    return path


def test_the_figures_show_the_runs_numbers_at_a_columns_width(run_dir: Path) -> None:
    run = read_run(run_dir)
    figures = paper_figures(run)
    assert tuple(figures) == NAMES
    for name, figure in figures.items():
        assert figure.get_figwidth() == COLUMN_IN
        for axes in figure.axes:
            assert axes.get_ylabel()
            assert min(float(text.get_fontsize()) for text in axes.get_yticklabels()) >= 7, name
        assert figure.axes[-1].get_xlabel()
    (view,) = run.hands.values()
    truth_line, hold, active = figures["position"].axes[0].get_lines()
    assert [line.get_label() for line in (truth_line, hold, active)] == ["truth", "hold", "innovations_kf"]
    assert np.asarray(truth_line.get_ydata()) == pytest.approx(1000 * view.track.truth_m[:, 0], nan_ok=True)
    drawn = np.asarray(figures["error"].axes[0].get_lines()[1].get_ydata(), dtype=float)
    assert np.nanmax(drawn) == pytest.approx(np.nanmax(view.errors_mm["innovations_kf"]))
    end_to_end = np.asarray(figures["latency_cdf"].axes[0].get_lines()[0].get_xdata(), dtype=float)
    assert end_to_end.max() == pytest.approx(run.summary.latency_ms.end_to_end["max"])
    counted = sum(bar.get_height() for bar in figures["loss_runs"].axes[0].containers[0])
    keys = run.summary.links["forward"].keys.values()
    assert counted == sum(key.loss_runs.count or 0 for key in keys)


@pytest.mark.parametrize("file_format", STARTS)
def test_the_command_writes_each_of_them(run_dir: Path, tmp_path: Path, file_format: str) -> None:
    words = ["report", str(run_dir), "--figures", str(tmp_path / "new" / "folder"), "--format", file_format]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    assert result.stdout.startswith("7 figures in ")
    for name in NAMES:
        assert (tmp_path / "new" / "folder" / f"{name}.{file_format}").read_bytes().startswith(STARTS[file_format])


def test_two_hands_have_figures_of_their_own_and_what_is_not_there_is_not_drawn(tmp_path: Path) -> None:
    patient = [message("tis/MTML/measured_cp", 0, 0.5, log_ms=11)]
    for hand in ("left", "right"):
        patient += [estimate(k, 10 * k, "hold", (0.001, 0, 0), hand=hand) for k in range(3)]
    write_run(tmp_path, surgeon=[truth(k, 10 * k, (0, 0, 0)) for k in range(3)], patient=patient)
    scenario = a_scenario(source={"kind": "synthetic", "hands": ["left", "right"]})
    measured = MeasuredRun(load_run(tmp_path), scenario, {"left": "PSM2", "right": "PSM1"})
    run = RunView(measured, summary_of({}), {})
    assert tuple(paper_figures(run)) == ("position_left", "error_left")


def test_a_format_that_nobody_knows_is_refused(run_dir: Path, tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["report", str(run_dir), "--figures", str(tmp_path / "f"), "--format", "gif"])
    assert result.exit_code == 2
    assert result.stderr.strip() == "tis: tis report: --format: must be one of svg, pdf, png (got 'gif')"
    assert not (tmp_path / "f").exists()
