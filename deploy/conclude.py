"""The end of every run, live or twin: logs to summary, manifest, table and report."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.markup import escape

from common.channels import Side
from common.errors import EXIT_INVALID_RUN, EXIT_OK, DataError, Fault, InputError
from common.scenario import Scenario
from deploy import run_dir as folder
from deploy.report.load import RunLogs, load_run
from deploy.report.summary import build_summary
from deploy.report.table import print_summary
from patient_side.identification.model_io import parse_models
from patient_side.statespace import ArmModel

_GET_BOKEH: Final = "pip install 'tis-testbed[report]'"


@dataclass(frozen=True)
class Ending:
    """How a run came about and ended; ``exit_code`` is None when nobody here saw it end."""

    mode: str
    command: str
    exit_code: int | None
    exit_codes: Mapping[Side, int]


def conclude(run_dir: Path, scenario: Scenario, ending: Ending, out: Console, report: bool = True) -> int:
    """Write summary, model, manifest and report of a run and print the summary; return 0 or `EXIT_INVALID_RUN`.

    ``report`` asks for the report, which needs Bokeh; a line says so when there is none.
    """
    logs = load_run(run_dir)
    models = _models(logs)
    summary = build_summary(logs, scenario, models, ending.mode, ending.exit_code, ending.command)
    folder.write_json(run_dir / folder.SUMMARY_FILE, summary)
    manifest = folder.manifest(run_dir, ending.command, ending.mode, ending.exit_codes)
    folder.write_json(run_dir / folder.MANIFEST_FILE, manifest)
    print_summary(summary, out)
    out.print(f"The run lies in {run_dir}: summary.json, manifest.json and the logs (.mcap)", soft_wrap=True)
    if report:
        _print_report(logs, scenario, models, summary, manifest, out)
    return EXIT_OK if summary["valid"] else EXIT_INVALID_RUN


def conclude_again(run_dir: Path, out: Console) -> int:
    """Summarise a folder of logs: gathered from several hosts, or of a run that has been summarised before.

    Gathered logs become a whole run folder: scenario and model are stored beside them, as info and replay need them.
    Raises `DataError` when the folder holds no scenario, neither as a file nor in a log, or logs of different ones.
    """
    logs = load_run(run_dir)
    recorded = scenario_in(logs)
    scenario = folder.read_scenario(run_dir, recorded)
    if recorded is not None and not (run_dir / folder.SCENARIO_FILE).exists():
        folder.write(run_dir / folder.SCENARIO_FILE, recorded)
    before = folder.read_json(run_dir / folder.SUMMARY_FILE) or {}
    manifest = folder.read_json(run_dir / folder.MANIFEST_FILE) or {}
    mode = _mode(logs)
    command = before.get("command", folder.command_line())
    return conclude(run_dir, scenario, Ending(mode, command, before.get("exit"), manifest.get("exit_codes", {})), out)


def report_again(run_dir: Path, out: Console) -> int:
    """Write the report of a run folder, whatever is left in it; without a summary it is made from the logs.

    Raises `InputError` without Bokeh, `DataError` when the folder is no run or its summary cannot be read.
    """
    if not _can_report():
        raise InputError(Fault("tis report", "", f"needs Bokeh: {_GET_BOKEH}"))
    logs = load_run(run_dir)
    scenario = folder.read_scenario(run_dir, scenario_in(logs))
    models = _models(logs)
    computed = build_summary(logs, scenario, models, _mode(logs), None, "")
    summary = folder.read_json(run_dir / folder.SUMMARY_FILE) or computed
    absent = computed.keys() - summary.keys()
    for direction, link in summary.get("links", {}).items():
        absent |= {f"links.{direction}.{name}" for name in computed["links"][direction].keys() - link.keys()}
    if absent:
        rule = f"is no summary of this version: it has no {', '.join(sorted(absent))}; see tis summarize"
        raise DataError(Fault(str(run_dir / folder.SUMMARY_FILE), "", rule))
    manifest = folder.read_json(run_dir / folder.MANIFEST_FILE) or {}
    _print_report(logs, scenario, models, summary, manifest, out)
    return EXIT_OK


def _mode(logs: RunLogs) -> str:
    return next((log.metadata["mode"] for log in logs.sides.values() if "mode" in log.metadata), "live")


def _can_report() -> bool:
    return find_spec("bokeh") is not None


def _print_report(
    logs: RunLogs,
    scenario: Scenario,
    models: Sequence[ArmModel],
    summary: dict[str, Any],
    manifest: Mapping[str, Any],
    out: Console,
) -> None:
    """Write the report and name it, or say how to get one."""
    if not _can_report():
        out.print(escape(f"No report was written, since Bokeh is not installed: {_GET_BOKEH}"), soft_wrap=True)
        return
    # Bokeh takes a while to load, so only now
    from deploy.report.html import report_html
    from deploy.report.sections import RunView, arms_of

    arms = arms_of(scenario, {model.hand: model.arm for model in models})
    versions = {"python": manifest["python"], **manifest["versions"]} if "versions" in manifest else {}
    path = logs.run_dir / folder.REPORT_FILE
    folder.write(path, report_html(RunView(logs, scenario, summary, arms, versions)))
    out.print(escape(f"Report: {path}"), soft_wrap=True)


def scenario_in(logs: RunLogs) -> str | None:
    """Return the scenario (YAML) that the logs hold, None when none does; raises `DataError` when they differ."""
    texts = {
        log.attachments[folder.SCENARIO_FILE]
        for log in logs.sides.values()
        if folder.SCENARIO_FILE in log.attachments
    }
    if len({log.metadata["digest"] for log in logs.sides.values() if "digest" in log.metadata}) > 1:
        raise DataError(Fault(str(logs.run_dir), "", "holds logs of different scenarios"))
    return next(iter(texts)).decode() if texts else None


def _models(logs: RunLogs) -> tuple[ArmModel, ...]:
    """Return the models that the patient's log holds, and store them beside it."""
    log = logs.sides.get("patient")
    data: Any = None if log is None else log.attachments.get(folder.MODEL_FILE)
    if data is None:
        return ()
    folder.write(logs.run_dir / folder.MODEL_FILE, data.decode())
    return parse_models(data.decode(), "patient.mcap")
