"""Commands on the folder of a standalone netem: completion, ``tis summarize``, ``tis report``, ``tis info``."""

from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape

from common.channels import Side
from common.errors import EXIT_INVALID_RUN, EXIT_LOSSY_RECOVERY, EXIT_OK, Fault, InputError
from common.extras import GET_REPORT
from common.runtime.command_line import command_line
from common.scenario.network import NetworkPart
from deploy.shell import run_dir as folder
from deploy.shell.extras import can_report
from deploy.shell.messages import print_json
from deploy.standalone.standalone_run import NETWORK_FILE, StandaloneRun, load_standalone, network_lines
from deploy.standalone.summary import build_summary
from deploy.standalone.terminal import summary_view
from deploy.tools.info import log_states, print_damage, print_files, states_as_data
from netem.bridge.standalone import network_yaml


def close_folder(run_dir: Path, network: NetworkPart, exit_code: int) -> None:
    """Write the used network and the manifest beside netem's log at its end; raises `DataError`."""
    folder.write(run_dir / NETWORK_FILE, network_yaml(network))
    _write_manifest(run_dir, command_line(), exit_code)


def summarize(run_dir: Path, out: Console, as_json: bool = False) -> int:
    """Write summary.json, and the files that a killed netem did not write; print the summary. Raises `DataError`."""
    run = load_standalone(run_dir)
    summary = _computed(run)
    if not (run_dir / NETWORK_FILE).exists():
        folder.write(run_dir / NETWORK_FILE, network_yaml(run.request.network))
    folder.write_json(run_dir / folder.SUMMARY_FILE, summary)
    _write_manifest(run_dir, summary["command"], summary["exit"])
    out.print(summary_view(summary))
    if as_json:
        print_json(summary | {"run_dir": str(run_dir)})
    return EXIT_OK if summary["valid"] else EXIT_INVALID_RUN


def report(run_dir: Path, out: Console) -> int:
    """Write report.html from the log; 0, or `EXIT_LOSSY_RECOVERY` when it is damaged.

    Raises `InputError` without Bokeh, `DataError`.
    """
    if not can_report():
        raise InputError(Fault("tis report", "", f"needs Bokeh: {GET_REPORT}"))
    from deploy.standalone.report_page import report_html  # loading Bokeh is slow

    run = load_standalone(run_dir)
    manifest = folder.read_json(run_dir / folder.MANIFEST_FILE) or {}
    path = run_dir / folder.REPORT_FILE
    folder.write(path, report_html(run, _computed(run), manifest.get("versions", {}) | run.versions))
    out.print(escape(f"Report: {path}"), soft_wrap=True)
    problem = run.log.coverage.problem
    if problem is None:
        return EXIT_OK
    out.print(escape(f"  not valid: netem: {problem}"), style="red", soft_wrap=True)
    return EXIT_LOSSY_RECOVERY


def info(run_dir: Path, out: Console, err: Console, as_json: bool = False) -> int:
    """Print the requested network, the summary, the command and the state of the log; raises `DataError`.

    Returns 0, or `DataError.exit_code` when the log is missing or damaged.
    """
    states = log_states(run_dir, ("netem.mcap",))
    code = print_damage(run_dir, states, err)
    run = load_standalone(run_dir)
    for line in network_lines(run):
        out.print(escape(line), soft_wrap=True, highlight=False)
    summary = _computed(run)
    out.print(summary_view(summary))
    print_files(run_dir, states, out)
    if as_json:
        print_json({"run_dir": str(run_dir), "summary": summary, "logs": states_as_data(states)})
    return code


def _computed(run: StandaloneRun) -> dict[str, Any]:
    """Return the summary, with the exit code from the manifest, if there is one."""
    manifest = folder.read_json(run.logs.run_dir / folder.MANIFEST_FILE) or {}
    return build_summary(run, manifest.get("exit_codes", {}).get("netem"))


def _write_manifest(run_dir: Path, command: str, exit_code: int | None) -> None:
    codes: dict[Side, int] = {} if exit_code is None else {"netem": exit_code}
    folder.write_json(run_dir / folder.MANIFEST_FILE, folder.manifest(run_dir, command, "live", codes))
