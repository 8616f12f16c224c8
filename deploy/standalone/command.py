"""Commands on the folder of a standalone netem: completion, ``tis summarize``, ``tis report``, ``tis info``."""

from pathlib import Path
from typing import Any, Final, get_args

from rich import box
from rich.console import Console, Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from tis.common.channels import Direction, Side
from tis.common.errors import EXIT_INVALID_RUN, EXIT_LOSSY_RECOVERY, EXIT_OK, GET_REPORT, Fault, InputError
from tis.common.records import COUNTERS
from tis.common.runtime.process import command_line
from tis.common.scenario.network import NetworkPart
from tis.common.units import NS_PER_S
from tis.deploy.logs.read.batches import link_fates, link_releases
from tis.deploy.report.link_summary import link_summary
from tis.deploy.report.measures.network.link_books import against_counters, counted, counter
from tis.deploy.report.measures.processors import processors_summary
from tis.deploy.report.tables.hanging_indent import HangingIndent
from tis.deploy.report.tables.numbers import number
from tis.deploy.report.tables.terminal import delays_view, drop_reasons
from tis.deploy.report.verdict.verdict_text import FIDELITY_STYLES, fidelity_text
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.extras import can_report
from tis.deploy.shell.guard import print_json
from tis.deploy.standalone.standalone_run import NETWORK_FILE, StandaloneRun, load_standalone, network_lines
from tis.deploy.tools.info import log_states, print_damage, print_files, states_as_data
from tis.netem.bridge.standalone import network_yaml
from tis.netem.expected.figures import direction_label

# Terminal view of a standalone netem's summary.

_MAX_SENTENCES: Final = 6
_COUNTS: Final = ("offered", "copied", "released", "dropped", "held_at_end")


def summary_view(summary: dict[str, Any]) -> RenderableType:
    """Return the verdicts, then the packets and the delays of both directions."""
    links = summary["links"]
    parts: list[RenderableType] = [Text(_headline(summary), style="bold")]
    parts += [HangingIndent(f"not valid: {text}", "red") for text in summary["problems"]]
    parts += [_verdict(direction, link["verdict"]) for direction, link in links.items()]
    return Group(*parts, _packets(links), delays_view(links, "by the options"))


def _headline(summary: dict[str, Any]) -> str:
    profile = "" if summary["profile"] is None else f", profile {summary['profile']}"
    begun = "" if summary["begun"] is None else f", begun {summary['begun']}"
    keys = ", ".join(summary["keys"])
    return f"netem between two networks for {summary['duration_s']:.1f} s: {keys}{profile}{begun}"


def _verdict(direction: Any, verdict: dict[str, Any]) -> Group:
    words, style = fidelity_text(verdict, "the request"), FIDELITY_STYLES[verdict["faithful"]]
    shown = [*verdict["violations"], *(f"warning: {warning}" for warning in verdict["warnings"])]
    shown = shown or verdict["not_decidable"]
    lines = shown[:_MAX_SENTENCES]
    if len(shown) > _MAX_SENTENCES:
        lines.append(f"and {len(shown) - _MAX_SENTENCES} more, see summary.json")
    return Group(
        HangingIndent(f"{direction_label(direction)}: {words}", style),
        *(HangingIndent(sentence, style, indent=4) for sentence in lines),
    )


def _table(title: str, columns: tuple[str, ...]) -> Table:
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("", no_wrap=True)
    for name in columns:
        table.add_column(name, justify="right", no_wrap=True)
    return table


def _with_note(table: Table, note: str) -> RenderableType:
    """Return a table with a note below it, as wide as the console."""
    return Group(table, Text(note, style="table.caption"))


def _packets(links: dict[str, Any]) -> RenderableType:
    names = ("offered", "copied", "released", "dropped", "held", "lost %", "mean run")
    table = _table("Messages", names)
    for direction, link in links.items():
        shares = (link["loss_pct"], link["loss_runs"]["mean"])
        table.add_row(direction, *(number(link[name]) for name in _COUNTS), *(number(share) for share in shares))
    note = f"dropped: by netem{drop_reasons(links)}; held: still under way at the end; mean run: of losses in a row. "
    return _with_note(table, f"{note}netem's log does not cover what happened before and behind it")


# Summary of a standalone netem: the links' part of a run's ``summary.json``, under the same names.

KIND = "standalone netem"


def build_summary(run: StandaloneRun, exit_code: int | None) -> dict[str, Any]:
    """Return the requested, decided and realised figures of each link with the verdict; unknown values are null.

    Unknown are only values from senders' and receivers' logs: ``sent``, ``received``, losses outside netem.
    Oracle: a real bridge between two clients, tests/deploy/standalone.
    """
    logs, log = run.logs, run.log
    problems = [f"netem: {text}"] if (text := log.coverage.problem) else []
    links: dict[str, Any] = {}
    for direction in get_args(Direction):
        links[direction], faults = link_summary(logs, direction, run.request)
        problems += faults
        counts = counted((link_fates(logs, direction),), (link_releases(logs, direction),))
        problems += [f"links.{direction}: {text}" for text in against_counters(logs, direction, counts)]
    if leaks := counter(logs, "leaks"):
        ways = "1 way past netem was" if leaks == 1 else f"{leaks} ways past netem were"
        problems.append(f"{ways} found: messages crossed without it")
    return {
        "kind": KIND,
        "seed": run.request.seed,
        "keys": list(run.request.keys),
        "profile": run.request.network.from_profile,
        "mode": "live",
        "exit": exit_code,
        "command": run.about.get("command", ""),
        "begun": run.about.get("begun"),
        "versions": run.versions,
        "duration_s": log.last_ns / NS_PER_S,
        "complete": bool(log.of(COUNTERS)),
        "links": links,
        "processors": processors_summary(logs, ("netem",)),
        "problems": problems,
        "valid": not problems,
    }


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
    from tis.deploy.standalone.report_page import report_html  # loading Bokeh is slow

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
