"""`tis run`: launch, watch, sum up."""

from pathlib import Path

from rich.console import Console
from rich.markup import escape

from common.errors import EXIT_OK
from common.runtime.side_cli import run_folder
from common.scenario import Scenario
from deploy import run_dir as folder
from deploy.launch import launch
from deploy.progress import RunProgress


def run_live(scenario: Scenario, run_dir: Path | None, out: Console, err: Console, report: bool = True) -> int:
    """Run the three processes, write summary, manifest and report, print the summary; return the exit code.

    A run in which no side came as far as running leaves no folder behind.
    """
    path = folder.create(run_dir or run_folder(Path("runs"), scenario.name), scenario)
    progress = RunProgress(err, scenario.duration_s)
    progress.start()
    try:
        outcome = launch(scenario, path, progress.take)
    finally:
        progress.stop()
    for reason in outcome.reasons:
        err.print(escape(f"tis: {reason}"), style="red", soft_wrap=True)
    if outcome.exit_code != EXIT_OK and not progress.began:
        folder.remove_unused(path)
        return outcome.exit_code
    # What reads the logs loads while nobody waits for the first movement.
    from deploy.conclude import Ending, conclude

    ending = Ending("live", folder.command_line(), outcome.exit_code, outcome.exit_codes)
    code = conclude(path, scenario, ending, out, report)
    return outcome.exit_code or code
