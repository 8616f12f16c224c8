"""Live run of `tis run`: launch, progress, conclusion."""

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from tis.common.errors import EXIT_INTERRUPTED, EXIT_OK
from tis.common.runtime.credentials import credentials, own_client
from tis.common.runtime.process import command_line
from tis.common.runtime.recordings import check_recording
from tis.common.runtime.run_folders import RUNS, run_folder
from tis.common.runtime.running import Running, announced
from tis.common.runtime.scenario_files import load_traces
from tis.common.runtime.zenoh_session import ZenohOptions
from tis.common.scenario import Scenario, check_foreign_surgeon
from tis.common.scenario.identification import is_model_file
from tis.common.sight.codec import check_codec
from tis.deploy.run.progress import RunProgress
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.guard import print_faults
from tis.deploy.shell.launch import endpoints_of, launch
from tis.deploy.shell.outcome import Event
from tis.deploy.view.page_process import PageAddress, PageProcess, page_beside
from tis.deploy.view.page_text import RunOutput
from tis.deploy.watch.observer import Observer
from tis.patient_side.models import own_estimators, read_models
from tis.patient_side.plant.physics import check_plant

if TYPE_CHECKING:
    from tis.deploy.run.conclude import Outputs


def run_live(
    scenario: Scenario, run_dir: Path | None, out: Console, err: Console,
    outputs: "Outputs", view: PageAddress | None, insecure: bool = False, foreign_surgeon: bool = False,
) -> int:  # fmt: skip
    """Run the three processes, write summary, manifest and report, print the summary; return the exit code.

    ``view`` enables the live page; ``insecure`` and ``foreign_surgeon`` as for `launch`. A run in which no side
    started running leaves no folder behind.
    """
    _check_before(scenario, foreign_surgeon)
    proof = credentials(scenario.security, "netem")
    path = folder.create(run_dir or run_folder(RUNS, scenario.name), scenario)
    west, east = endpoints = endpoints_of(scenario)
    visits = ZenohOptions(credentials=own_client(proof))
    observer = Observer({"west": west, "east": east}, scenario.session, zenoh=visits)
    progress = RunProgress(
        err, scenario.duration_s, scenario.name, lambda: observer.read(lambda book: book.figures())
    )
    # The page comes first: without one there is to be no run, and its folder goes again.
    with ExitStack() as stack:
        page: PageProcess | None = None
        try:
            if view is not None:
                page = stack.enter_context(page_beside(view, endpoints, scenario, err, visits, outputs.report))
        except BaseException:
            folder.remove_unused(path)
            raise
        err.print(f"netem joins {west} (west) and {east} (east)", style="dim", soft_wrap=True)
        err.print("tis view and tis net find it, in another terminal", style="dim")
        progress.start()
        during, here = ExitStack(), Running(west, east, scenario.session, f"tis run {scenario.name}")

        def take(event: Event) -> None:
            if event["event"] == "ready" and event["side"] == "netem":
                during.enter_context(announced(here))
            if event["event"] == "running" and not progress.began:
                observer.start()  # not earlier: a run that fails at once needs no observer
            progress.take(event)

        # The run itself; the terminal is restored and the observer stopped however it ends.
        with during:
            during.callback(observer.stop)
            during.callback(progress.stop)
            outcome = launch(scenario, path, take, endpoints, insecure, foreign_surgeon)
        if outcome.exit_code == EXIT_INTERRUPTED:
            err.print("interrupted: what follows is of the run up to here, as its logs are", style="yellow")
        else:
            print_faults(err, *outcome.reasons)
        if outcome.exit_code != EXIT_OK and not progress.began:
            folder.remove_unused(path)
            return outcome.exit_code
        # Imported late: loading the log reader would delay the first movement.
        from tis.deploy.run.conclude import Ending, conclude

        ending = Ending("live", command_line(), outcome.exit_code, outcome.exit_codes, progress.told)
        code = conclude(path, scenario, ending, out, outputs)
        if page is not None:
            page.send_output(_run_output(path))
    return outcome.exit_code or code


def _check_before(scenario: Scenario, foreign_surgeon: bool) -> None:
    """Raise `InputError` and `DataError` before any folder or process exists, instead of in a side's process."""
    scenario.identification.check_for_live_runs(scenario.estimators)
    check_plant(scenario)
    check_codec(scenario)
    own_estimators(scenario)
    if foreign_surgeon:
        check_foreign_surgeon(f"scenario {scenario.name}", scenario.source)
    check_recording(scenario)
    load_traces(scenario.network)
    if is_model_file(scenario.identification.train):
        read_models(Path(scenario.identification.train))


def _run_output(run_dir: Path) -> RunOutput:
    """Return the report, or else the folder, that the page links to after the run."""
    report = run_dir / folder.REPORT_FILE
    kind, path = ("report", report) if report.exists() else ("folder", run_dir)
    return RunOutput(kind, str(path.resolve()))
