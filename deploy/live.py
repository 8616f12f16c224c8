"""`tis run`: launch, watch, sum up."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape

from common.channels import Side
from common.errors import EXIT_INVALID_RUN, EXIT_OK
from common.runtime.side_cli import run_folder
from common.scenario import Scenario
from deploy import run_dir as folder
from deploy.launch import launch
from deploy.progress import RunProgress
from deploy.report.load import RunLogs, load_run
from deploy.report.summary import build_summary
from deploy.report.table import print_summary
from patient_side.identification.model_io import parse_models
from patient_side.statespace import ArmModel


def run_live(scenario: Scenario, run_dir: Path | None, out: Console, err: Console) -> int:
    """Run the three processes, write summary and manifest, print the summary; return the exit code."""
    path = folder.create(run_dir or run_folder(Path("runs"), scenario.name), scenario)
    progress = RunProgress(err, scenario.duration_s)
    progress.start()
    try:
        outcome = launch(scenario, path, progress.take)
    finally:
        progress.stop()
    for reason in outcome.reasons:
        err.print(escape(f"tis: {reason}"), style="red", soft_wrap=True)
    if outcome.exit_code != EXIT_OK and _nothing_ran(path):
        folder.remove_unused(path)
        return outcome.exit_code
    code = conclude(path, scenario, "live", outcome.exit_code, outcome.exit_codes, out)
    return outcome.exit_code or code


def summarize_logs(run_dir: Path, out: Console) -> int:
    """Write and print the summary of a folder of logs; raises `DataError`."""
    scenario = folder.read_scenario(run_dir)
    return conclude(run_dir, scenario, "live", EXIT_OK, {}, out)


def conclude(
    run_dir: Path, scenario: Scenario, mode: str, exit_code: int, exit_codes: Mapping[Side, int], out: Console
) -> int:
    """Write summary, model and manifest of a finished run and print the summary; return 0 or `EXIT_INVALID_RUN`."""
    logs = load_run(run_dir)
    models = _models(logs)
    command = folder.command_line()
    summary = build_summary(logs, scenario, models, mode, exit_code, command)
    folder.write_json(run_dir / folder.SUMMARY_FILE, summary)
    folder.write_json(run_dir / folder.MANIFEST_FILE, folder.manifest(run_dir, command, mode, exit_codes))
    print_summary(summary, out)
    out.print(f"The run lies in {run_dir}: summary.json, manifest.json, model.json and three logs (.mcap).")
    return EXIT_OK if summary["valid"] else EXIT_INVALID_RUN


def _models(logs: RunLogs) -> tuple[ArmModel, ...]:
    """Return the models that the patient's log holds, and store them beside it."""
    log = logs.sides.get("patient")
    data: Any = None if log is None else log.attachments.get(folder.MODEL_FILE)
    if data is None:
        return ()
    folder.write(logs.run_dir / folder.MODEL_FILE, data.decode())
    return parse_models(data.decode(), "patient.mcap")


def _nothing_ran(run_dir: Path) -> bool:
    return not any(logs.n_messages for logs in load_run(run_dir).sides.values())
