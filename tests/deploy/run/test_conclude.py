"""Summing up: logs gathered from several hosts, logs of a killed run, logs that do not belong together."""

import io
import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from tests.deploy.report.hand_made import COMMAND, a_scenario, message, write_log
from tests.deploy.report.partial import causes
from tis.common.errors import EXIT_INVALID_RUN, EXIT_OK, DataError
from tis.common.scenario import Scenario
from tis.common.scenario.reading import digest, dump_scenario
from tis.deploy.logs.read.load import load_run
from tis.deploy.run.conclude import conclude_again
from tis.deploy.run.replay import replay
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, run_twin
from tis.deploy.shell import run_dir as folder
from tis.deploy.tools.info import print_info

SIDES = ("surgeon", "netem", "patient")


@pytest.fixture(scope="module")
def twin_logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The three logs of a run of 3 s, and nothing else."""
    path = tmp_path_factory.mktemp("twin")
    scenario = resolve("default", ["estimators=[hold, innovations_kf]"], None, 3.0)
    nodes, models, _ = build_sides(scenario)
    run_twin(scenario, nodes, models, path)
    return path


@pytest.fixture
def gathered(twin_logs: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(twin_logs, tmp_path / "gathered"))


def _summary(run_dir: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((run_dir / "summary.json").read_text())
    return content


def test_gathered_logs_become_a_whole_run_folder(gathered: Path) -> None:
    out = io.StringIO()
    assert conclude_again(gathered, Console(file=out, width=200)) == EXIT_OK
    summary = _summary(gathered)
    assert (summary["valid"], summary["mode"], summary["exit"]) == (True, "twin", None)
    assert summary["ticks"]["count"] == 90
    assert "end to end    median" in out.getvalue()
    names = {path.name for path in gathered.iterdir()}
    assert {"scenario.yaml", "summary.json", "manifest.json", "model.json", "report.html"} <= names
    assert folder.read_scenario(gathered).duration_s == 3
    assert replay(gathered).identical
    assert print_info(gathered, Console(quiet=True), Console(quiet=True)) == EXIT_OK


def test_summing_up_again_keeps_how_the_run_ended_and_its_command(gathered: Path, without_report: None) -> None:
    conclude_again(gathered, Console(quiet=True))
    first = _summary(gathered)
    folder.write_json(gathered / "summary.json", first | {"exit": 3, "command": "tis run mine.yaml"})
    manifest = json.loads((gathered / "manifest.json").read_text())
    folder.write_json(gathered / "manifest.json", manifest | {"exit_codes": {"netem": -9}})
    conclude_again(gathered, Console(quiet=True))
    assert _summary(gathered) == first | {"exit": 3, "command": "tis run mine.yaml"}
    again = json.loads((gathered / "manifest.json").read_text())
    assert (again["exit_codes"], again["command"]) == ({"netem": -9}, "tis run mine.yaml")


def _log_of(run_dir: Path, side: str, scenario: Scenario) -> None:
    write_log(
        run_dir,
        side,  # type: ignore[arg-type]
        [message(COMMAND, 0, 0)],
        {"digest": digest(scenario), "mode": "live"},
        {"scenario.yaml": dump_scenario(scenario).encode()},
    )


@pytest.mark.parametrize("with_file", [False, True])
def test_logs_of_different_scenarios_are_refused_and_nothing_is_written(tmp_path: Path, with_file: bool) -> None:
    _log_of(tmp_path, "surgeon", a_scenario(seed=1))
    _log_of(tmp_path, "netem", a_scenario(seed=2))
    if with_file:
        (tmp_path / "scenario.yaml").write_text(dump_scenario(a_scenario(seed=1)))
    before = {path.name for path in tmp_path.iterdir()}
    with pytest.raises(DataError, match="holds logs of different scenarios"):
        conclude_again(tmp_path, Console(quiet=True))
    assert {path.name for path in tmp_path.iterdir()} == before


def test_logs_of_hosts_with_different_addresses_belong_together(tmp_path: Path) -> None:
    for side, port in zip(SIDES, (7447, 7457, 7467), strict=True):
        hosts = {"west": f"tcp/10.0.0.1:{port}", "east": f"tcp/10.0.0.2:{port}"}
        _log_of(tmp_path, side, a_scenario(hosts=hosts))
    assert conclude_again(tmp_path, Console(quiet=True)) == EXIT_INVALID_RUN  # a run without ticks
    assert _summary(tmp_path)["mode"] == "live"


def test_a_missing_log_gives_a_summary_that_says_so(gathered: Path, without_report: None) -> None:
    (gathered / "netem.mcap").unlink()
    assert conclude_again(gathered, Console(quiet=True)) == EXIT_INVALID_RUN
    assert causes(_summary(gathered)["problems"]) == ["netem: log is missing"]


@pytest.mark.parametrize("side", SIDES)
def test_an_empty_log_of_a_killed_side_is_a_problem_of_the_run_not_another_scenario(
    gathered: Path, side: str, without_report: None
) -> None:
    (gathered / f"{side}.mcap").write_bytes(b"")
    assert conclude_again(gathered, Console(quiet=True)) == EXIT_INVALID_RUN
    assert f"{side}: log is damaged (the file is empty)" in causes(_summary(gathered)["problems"])
    out = io.StringIO()
    print_info(gathered, Console(file=out, width=200), Console(quiet=True))
    assert "damaged, nothing to recover: the file is empty" in out.getvalue()


def test_a_log_torn_within_its_head_has_no_digest_to_differ(gathered: Path, without_report: None) -> None:
    path = gathered / "surgeon.mcap"
    path.write_bytes(path.read_bytes()[:20])
    assert load_run(gathered).sides["surgeon"].metadata == {}
    assert conclude_again(gathered, Console(quiet=True)) == EXIT_INVALID_RUN


def test_a_folder_without_logs_and_scenario_is_no_run(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="is no run folder"):
        conclude_again(tmp_path, Console(quiet=True))
