"""Commands on the folder of a standalone netem: completion, ``tis summarize``, ``tis report``, ``tis info``."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final, get_args

from msgspec import convert
from rich.console import Console, Group, RenderableType
from rich.markup import escape
from rich.text import Text

from tis.common.channels import Direction, Side
from tis.common.errors import EXIT_INVALID_RUN, EXIT_LOSSY_RECOVERY, EXIT_OK, Fault, InputError
from tis.common.extras import GET_REPORT
from tis.common.records import CONTROL, COUNTERS, ControlNote
from tis.common.runtime.process import command_line
from tis.common.runtime.scheduling import give_way
from tis.common.scenario.network import NetworkPart
from tis.common.units import NS_PER_S
from tis.deploy.export.export import Exported, Formats
from tis.deploy.export.export import export as write_export
from tis.deploy.export.tables import tables_of_logs
from tis.deploy.logs.read.packets import link_fates, link_releases
from tis.deploy.report.command import write_figures
from tis.deploy.report.section import DirectionName, Section, SideName, means
from tis.deploy.report.subjects.logs import bypass_problems
from tis.deploy.report.subjects.network.link_books import against_counters, counted
from tis.deploy.report.subjects.network.link_figures import Link
from tis.deploy.report.subjects.network.link_summary import link_summary
from tis.deploy.report.subjects.network.link_tables import delay_table, packet_table
from tis.deploy.report.subjects.processors import ProcessorFigures, processors_summary
from tis.deploy.report.terminal import HangingIndent, verdict_view
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.guard import OUT, can_report, print_json
from tis.deploy.standalone.standalone_run import NETWORK_FILE, StandaloneRun, load_standalone, network_lines
from tis.deploy.tools.info import log_states, print_damage, print_files, states_as_data
from tis.netem.bridge.standalone_log import network_yaml
from tis.netem.control.replay import made_changes, weightiest
from tis.netem.expected.synopsis import direction_label

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KIND: Final = "standalone netem"
_MAX_CHANGES: Final = 6


class NetemSummary(Section):
    """Summary of a standalone netem: the links' part of a run's ``summary.json``, under the same names.

    Unknown are only values from senders' and receivers' logs: ``sent``, ``received``, losses outside netem.
    """

    kind: str = means("Kind of the summary.")
    seed: int = means("Seed of every random number.")
    keys: list[str] = means("Key expressions that crossed.")
    profile: str | None = means("Profile of the library that the network is from.")
    mode: str = means("`live`.")
    exit: int | None = means("Exit code; `null` while netem has not ended.")
    command: str = means("Command line that began it.")
    begun: str | None = means("Time of its begin.")
    versions: dict[str, str] = means("Versions of the packages that it used.")
    duration_s: float = means("Length of its log.")
    complete: bool = means("True when the log ends with netem's counters.")
    changes: list[str] = means("Changes made while it ran, in words, each with its direction and time.")
    links: dict[DirectionName, Link] = means("The two directions of the network.")
    processors: dict[SideName, ProcessorFigures | None] = means("Use of the processors.")
    problems: list[str] = means("Reasons for which it is not valid as a measurement.")
    valid: bool = means("True when `problems` is empty.")


def netem_summary(run: StandaloneRun, exit_code: int | None) -> NetemSummary:
    """Return the figures of each link with the verdict. Oracle: a real bridge, tests/deploy/standalone."""
    logs, log = run.logs, run.log
    problems = _damage(run)
    links: dict[Direction, Link] = {}
    for direction in get_args(Direction):
        links[direction], faults = link_summary(logs, direction, run.request)
        problems += faults
        counts = counted((link_fates(logs, direction),), (link_releases(logs, direction),))
        problems += [f"links.{direction}: {text}" for text in against_counters(logs, direction, counts)]
    problems += bypass_problems(logs)
    return NetemSummary(
        kind=KIND,
        seed=run.request.seed,
        keys=list(run.request.keys),
        profile=run.request.network.from_profile,
        mode="live",
        exit=exit_code,
        command=run.about.get("command", ""),
        begun=run.about.get("begun"),
        versions=run.versions,
        duration_s=log.last_ns / NS_PER_S,
        complete=bool(log.of(COUNTERS)),
        changes=[*map(str, made_changes(convert(row, ControlNote) for row in logs.of("netem", CONTROL)))],
        links=links,
        processors=processors_summary(logs, ("netem",)),
        problems=problems,
        valid=not problems,
    )


def named_changes(changes: Sequence[str]) -> list[str]:
    """Return a line for each of the weightiest changes made while running, then how many more there were."""
    left = len(changes) - _MAX_CHANGES
    named = [f"changed while running: {text}" for text in weightiest(changes, _MAX_CHANGES)]
    return [*named, f"and {left} more change{'s' * (left > 1)} while running"] if left > 0 else named


def summary_view(summary: NetemSummary) -> RenderableType:
    """Return the verdicts, then the packets and the delays of both directions."""
    links = summary.links
    profile = "" if summary.profile is None else f", profile {summary.profile}"
    begun = "" if summary.begun is None else f", begun {summary.begun}"
    crossing = f"{', '.join(summary.keys)}{profile}{begun}"
    parts: list[RenderableType] = [
        Text(f"netem between two networks for {summary.duration_s:.1f} s: {crossing}", style="bold")
    ]
    parts += [HangingIndent(text) for text in named_changes(summary.changes)]
    parts += [HangingIndent(f"not valid: {text}", "red") for text in summary.problems]
    parts += [
        verdict_view(direction_label(way), link.verdict, "the request", link.verdict.not_decidable)
        for way, link in links.items()
    ]
    beyond = Text("netem's log does not cover what happened before and behind it", style="table.caption")
    return Group(*parts, packet_table(links).terminal(), beyond, delay_table(links, "by the options").terminal())


def close_folder(run_dir: Path, network: NetworkPart, exit_code: int, summarized: bool = False) -> int:
    """Write the used network and the manifest beside netem's log at its end; raises `DataError`.

    With ``summarized`` also the summary. Returns the exit code, which is that of the summary if netem's own is 0.
    """
    folder.write(run_dir / NETWORK_FILE, network_yaml(network))
    _write_manifest(run_dir, command_line(), exit_code)
    if not summarized:
        return exit_code
    give_way()
    code = summarize(run_dir, OUT)
    return exit_code or code


def summarize(run_dir: Path, out: Console, as_json: bool = False) -> int:
    """Write summary.json, and the files that a killed netem did not write; print the summary. Raises `DataError`."""
    run = load_standalone(run_dir)
    summary = _computed(run)
    if not (run_dir / NETWORK_FILE).exists():
        folder.write(run_dir / NETWORK_FILE, network_yaml(run.request.network))
    folder.write_json(run_dir / folder.SUMMARY_FILE, summary.as_json())
    _write_manifest(run_dir, summary.command, summary.exit)
    out.print(summary_view(summary))
    if as_json:
        print_json(summary.as_json() | {"run_dir": str(run_dir)})
    return EXIT_OK if summary.valid else EXIT_INVALID_RUN


def report(run_dir: Path, out: Console) -> int:
    """Write report.html from the log; 0, or `EXIT_LOSSY_RECOVERY` when it is damaged.

    Raises `InputError` without Bokeh, `DataError`.
    """
    if not can_report():
        raise InputError(Fault("tis report", "", f"needs Bokeh: {GET_REPORT}"))
    from tis.deploy.standalone.report_page import report_html  # loading Bokeh is slow

    run = load_standalone(run_dir)
    manifest = folder.read_json(run_dir / folder.MANIFEST_FILE) or {}
    path = run_dir / folder.REPORT_FILE
    folder.write(path, report_html(run, _computed(run), manifest.get("versions", {}) | run.versions))
    out.print(escape(f"Report: {path}"), soft_wrap=True)
    for text in (problems := _damage(run)):
        out.print(escape(f"  not valid: {text}"), style="red", soft_wrap=True)
    return EXIT_LOSSY_RECOVERY if problems else EXIT_OK


def draw_figures(run_dir: Path, into: Path, file_format: str, out: Console) -> int:
    """Write the network's figures for papers into a folder, as `tis.deploy.report.command.draw_figures` does."""

    def draw() -> "tuple[dict[str, Figure], list[str]]":
        from tis.deploy.report.publication.run_figures import network_figures

        run = load_standalone(run_dir)
        return network_figures(run.logs), _damage(run)

    return write_figures(run_dir, draw, into, file_format, out)


def export(run_dir: Path, out_dir: Path, formats: Formats, out: Console, err: Console) -> int:
    """Write the records as tables, as `tis.deploy.export.export.export` does; trials need surgeon and patient."""
    if formats.jigsaws:
        rule = "needs the logs of surgeon and patient: this is the folder of a standalone netem"
        raise InputError(Fault("tis export", "--jigsaws", rule, str(run_dir)))

    def read() -> Exported:
        run = load_standalone(run_dir)
        title = f"netem between two networks, seed {run.request.seed}"
        return Exported(title, _damage(run), tables_of_logs(run.logs))

    return write_export(run_dir, out_dir, formats, read, out, err)


def _damage(run: StandaloneRun) -> list[str]:
    return [] if run.log.coverage.problem is None else [f"netem: {run.log.coverage.problem}"]


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
        print_json({"run_dir": str(run_dir), "summary": summary.as_json(), "logs": states_as_data(states)})
    return code


def _computed(run: StandaloneRun) -> NetemSummary:
    """Return the summary, with the exit code from the manifest, if there is one."""
    manifest = folder.read_json(run.logs.run_dir / folder.MANIFEST_FILE) or {}
    return netem_summary(run, manifest.get("exit_codes", {}).get("netem"))


def _write_manifest(run_dir: Path, command: str, exit_code: int | None) -> None:
    codes: dict[Side, int] = {} if exit_code is None else {"netem": exit_code}
    folder.write_json(run_dir / folder.MANIFEST_FILE, folder.manifest(run_dir, command, "live", codes))
