"""The end of every run, live or twin: logs to summary, manifest, table and report."""

from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final, NamedTuple

from rich.console import Console
from rich.markup import escape

from tis.common.channels import Side
from tis.common.errors import EXIT_INVALID_RUN, EXIT_OK
from tis.common.runtime.process import command_line
from tis.common.scenario import Scenario
from tis.common.sources.provenance import MODEL_FILES
from tis.deploy.logs.merge_run import Merging, Opening, can_merge, merging, print_merged
from tis.deploy.logs.read.load import RunLogs, load_run, mode_of, models_in, origins_in, scenario_in
from tis.deploy.report.command import write_report
from tis.deploy.report.measured_run import MeasuredRun
from tis.deploy.report.run_view import RunView
from tis.deploy.report.summarise import summary_of
from tis.deploy.report.terminal import print_summary
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.guard import print_json


@dataclass(frozen=True)
class Ending:
    """Mode, command and exit codes of a run; ``exit_code`` is None when the end was not observed here.

    ``told`` are warnings that were printed before, which the brief does not repeat.
    """

    mode: str
    command: str
    exit_code: int | None
    exit_codes: Mapping[Side, int]
    told: Collection[str] = ()


class Outputs(NamedTuple):
    """The wanted outputs of a command on a run.

    ``report`` enables the report, which needs Bokeh (a line says when it is missing), ``merge`` run.mcap, ``verbose``
    all tables in the terminal. With ``as_json`` the summary is printed to standard output, beside the given console.
    """

    report: bool = True
    merge: bool = True
    verbose: bool = False
    as_json: bool = False


EVERYTHING: Final = Outputs()


def conclude(run_dir: Path, scenario: Scenario, ending: Ending, out: Console, outputs: Outputs = EVERYTHING) -> int:
    """Write summary, model, manifest, merged logs and report, print the summary; return 0 or `EXIT_INVALID_RUN`."""
    return _conclude(_read(run_dir, out), scenario, ending, out, outputs)


def _read(run_dir: Path, out: Console) -> RunLogs:
    with out.status("reading the logs"):
        return load_run(run_dir)


def _conclude(logs: RunLogs, scenario: Scenario, ending: Ending, out: Console, outputs: Outputs) -> int:
    models = models_in(logs)
    # the models attached to the patient's log become a file of the folder
    attached = logs.attachments("patient")
    for name in MODEL_FILES:
        if name in attached:
            folder.write(logs.run_dir / name, attached[name])
    run = MeasuredRun.of(logs, scenario, models)
    if not outputs.merge or not can_merge(logs.run_dir):
        return _summarise(run, ending, out, outputs, None)
    opening = Opening(ending.command, models[0].warnings if models else ())
    with merging(logs.run_dir, scenario, logs.clocks.models(), opening) as under_way:
        return _summarise(run, ending, out, outputs, under_way)


def _summarise(run: MeasuredRun, ending: Ending, out: Console, outputs: Outputs, under_way: Merging | None) -> int:
    logs = run.logs
    run_dir = logs.run_dir
    with out.status("computing the summary"):
        summary = summary_of(run, ending.mode, ending.exit_code, ending.command)
    folder.write_json(run_dir / folder.SUMMARY_FILE, summary.as_json())
    clocks = logs.clocks.hosts()
    own = {name: asdict(origin) for name, origin in origins_in(logs).items()}
    manifest = folder.manifest(run_dir, ending.command, ending.mode, ending.exit_codes, clocks, own)
    folder.write_json(run_dir / folder.MANIFEST_FILE, manifest)
    print_summary(summary, out, verbose=outputs.verbose, told=ending.told)
    if outputs.as_json:
        print_json(summary.as_json() | {"run_dir": str(run_dir)})
    tables = command_line(["info", "-v", str(run_dir)])
    out.print(escape(f"The run lies in {run_dir}; all tables: {tables}"), soft_wrap=True)
    if under_way is not None:
        under_way.concluded()
    with out.status("writing the report" if outputs.report else "merging the logs"):
        written = write_report(RunView.of(run, summary, manifest)) if outputs.report else None
        merged = None if under_way is None else under_way.merged()
    if merged is not None:
        print_merged(run_dir, merged, out)
    if written is not None:
        out.print(escape(written), soft_wrap=True)
    return EXIT_OK if summary.valid else EXIT_INVALID_RUN


def conclude_again(run_dir: Path, out: Console, outputs: Outputs = EVERYTHING) -> int:
    """Summarise a folder of logs: gathered from several hosts, or of a run that was summarised before.

    Gathered logs become a complete run folder: scenario and model, needed by info and replay, are stored beside them.
    Raises `DataError`, and writes nothing, when neither a file nor a log holds the scenario, when the logs hold
    different ones, or when a log file is not MCAP.
    """
    logs = _read(run_dir, out)
    recorded = scenario_in(logs)
    scenario = folder.read_scenario(run_dir, recorded)
    before = folder.read_json(run_dir / folder.SUMMARY_FILE) or {}
    manifest = folder.read_json(run_dir / folder.MANIFEST_FILE) or {}
    if recorded is not None and not (run_dir / folder.SCENARIO_FILE).exists():
        folder.write(run_dir / folder.SCENARIO_FILE, recorded)
    mode = mode_of(logs)
    command = before.get("command", command_line())
    ending = Ending(mode, command, before.get("exit"), manifest.get("exit_codes", {}))
    return _conclude(logs, scenario, ending, out, outputs)
