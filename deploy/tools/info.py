"""Command `tis info`: content of a run folder, damage first."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, get_args

from rich.console import Console
from rich.markup import escape

from tis.common.channels import Side
from tis.common.errors import EXIT_OK, DataError
from tis.common.runtime.log_parts import companion_logs, n_parts, part_name
from tis.common.runtime.mcap_log import is_being_written
from tis.common.units import NS_PER_S
from tis.deploy.logs.coverage import Coverage, spans_text
from tis.deploy.logs.describe import Described, describe
from tis.deploy.logs.log_file import truncated_start
from tis.deploy.logs.log_paths import log_file, recovered_name, recovery_of
from tis.deploy.logs.read.load import RunLogs, check_written_by_tis, load_run, scenario_in
from tis.deploy.present.table import Column, Table
from tis.deploy.report.summary import Summary, readable, summary_in
from tis.deploy.report.terminal import print_summary
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.guard import print_faults, print_json

_PART: Final = re.compile(rf"({'|'.join(get_args(Side))})(?:_([0-9]+))?\.mcap")


class LogState(NamedTuple):
    """A log's row in the table, and a text on its damage, None for an intact log."""

    cells: tuple[str, str, str, str]
    damage: str | None


States = dict[str, LogState | None]


def print_info(run_dir: Path, out: Console, err: Console, verbose: bool = False, as_json: bool = False) -> int:
    """Print missing or damaged logs, the summary if there is one, and the state of each log; raises `DataError`.

    Returns 0, or `DataError.exit_code` when a log is missing or damaged.
    """
    states = log_states(run_dir, (*_logs(run_dir), folder.MERGED_FILE))
    code = print_damage(run_dir, states, err)
    problems: list[str] = []
    try:
        logs = load_run(run_dir, wanted=())
        problems = logs.problems()
        recorded = scenario_in(logs)
    except DataError:  # printed above, unless the logs do not belong together
        if not any(state and state.damage for state in states.values()):
            raise
        logs, recorded = RunLogs(run_dir), None
    folder.read_scenario(run_dir, recorded)
    content = folder.read_json(run_dir / folder.SUMMARY_FILE)
    summary: Summary | None = None
    if content is not None:
        try:
            summary = summary_in(content, run_dir / folder.SUMMARY_FILE)
        except DataError as error:
            print_faults(err, str(error))
            print_files(run_dir, states, out)
            return DataError.exit_code
    # a summary that predates the damage is printed with a warning
    since = None
    if summary is None:
        out.print(
            "no summary.json: the run was aborted, or its logs come from several hosts; see tis summarize",
            soft_wrap=True,
        )
    else:
        if code != EXIT_OK and not (logs.sides and set(problems) <= set(summary.problems)):
            text = "summary.json is older than this damage: it describes the intact logs; see tis summarize"
            out.print(text, style="yellow", soft_wrap=True)
            since = _damage_summary(states)
        with readable(run_dir / folder.SUMMARY_FILE), out.capture() as shown:
            print_summary(summary, out, since, verbose)
        out.file.write(shown.get())
    print_files(run_dir, states, out)
    if as_json:
        print_json({"run_dir": str(run_dir), "summary": content, "logs": states_as_data(states)})
    return code


def print_damage(run_dir: Path, states: States, err: Console) -> int:
    """Print which logs are missing or damaged; return `DataError.exit_code` if any is."""
    is_run = any(states.values()) or (run_dir / folder.SCENARIO_FILE).exists()
    found = [
        f"{run_dir}: {name} is missing"
        for name, state in states.items()
        if is_run and state is None and name != folder.MERGED_FILE
    ]
    found += [f"{run_dir / name}: {state.damage}" for name, state in states.items() if state and state.damage]
    print_faults(err, *found)
    return DataError.exit_code if found else EXIT_OK


def _damage_summary(states: States) -> str | None:
    """Return a text that lists the lost and damaged logs of the sides, None without any."""
    sides = {name: state for name, state in states.items() if _PART.fullmatch(name)}
    found = [f"{name} was lost" for name, state in sides.items() if state is None]
    found += [f"{name} was damaged" for name, state in sides.items() if state and state.damage]
    return " and ".join(found) or None


def states_as_data(states: States) -> dict[str, Any]:
    """Return the state of each log for JSON, None for a missing one."""
    found: dict[str, Any] = dict.fromkeys(states)
    for name, state in states.items():
        if state is not None:
            messages, until_s, size_kb, text = state.cells
            counts = {"messages": int(messages) if messages else None, "until_s": float(until_s) if until_s else None}
            found[name] = {**counts, "size_kb": int(size_kb), "state": text, "damage": state.damage}
    return found


def print_files(run_dir: Path, states: States, out: Console) -> None:
    """Print how the run was started, and the length and state of each log."""
    manifest = folder.read_json(run_dir / folder.MANIFEST_FILE)
    if manifest is not None:
        found = manifest.get("versions")
        versions = ", ".join(f"{name} {value}" for name, value in (found if isinstance(found, dict) else {}).items())
        revision = manifest.get("git_revision") or "unknown"
        out.print(escape(f"command {manifest.get('command', '-')}, revision {revision}, {versions}"))
    missing = {folder.MERGED_FILE: "missing, see tis merge"}
    rows = [
        (name, *(("", "", "", missing.get(name, "missing")) if state is None else state.cells))
        for name, state in states.items()
    ]
    heads = {"log": True, "messages": False, "until s": False, "size kB": False, "state": True}
    columns = [Column(head, words=words, wraps=True) for head, words in heads.items()]
    out.print(Table("Logs", columns, rows).terminal())


def _logs(run_dir: Path) -> list[str]:
    """Return the names of the logs that a run's folder must have, of later parts, and of camera and screen."""
    own = [part_name(side, n + 1) for side in get_args(Side) for n in range(max(1, n_parts(run_dir, side)))]
    return own + [path.name for side in get_args(Side) for path in companion_logs(run_dir, side)]


def log_states(run_dir: Path, names: Sequence[str]) -> States:
    """Read the logs of the given names and their recovered copies; None for a missing one."""
    found: States = {}
    for name in names:
        path = run_dir / name
        part = _part_of(name)
        read = path if part is None else log_file(run_dir, *part)
        if path.exists() or read == path:
            found[name] = _state(path, read) if path.exists() else None
        spare = recovered_name(path)
        if read != path:
            found[read.name] = _recovered(read)
        elif part is not None and spare.is_file():
            why = f"not recovered from this {name}" if recovery_of(spare) else "not marked as recovered"
            found[spare.name] = LogState(("", "", _size_kb(spare), f"not read: {why}"), None)
    return found


def _part_of(name: str) -> tuple[Side, int] | None:
    """Return the side and the number of the part that a log's name says; None for any other file."""
    found = _PART.fullmatch(name)
    side = None if found is None else next(side for side in get_args(Side) if side == found[1])
    return None if found is None or side is None else (side, int(found[2] or 1))


def _follower(path: Path) -> str | None:
    """Return the name of the part that goes on where this log ends; None without one."""
    part = _part_of(path.name)
    name = None if part is None else part_name(part[0], part[1] + 1)
    return name if name is not None and path.with_name(name).exists() else None


def _state(path: Path, read: Path) -> LogState:
    """Return the state of a log; ``read`` is the recovered file that replaces it, or the log itself."""
    size = _size_kb(path)
    try:
        is_log = _part_of(path.name) is not None
        rule, found = (truncated_start(path) if is_log else None), None
        if rule is None:
            found = describe(path)
            rule = found.log.damage
            if is_log:
                check_written_by_tis(found.log)
    except DataError as error:
        rule = error.faults[0].rule
        return LogState(("0", "", size, f"no log: {rule}"), rule)
    cells = ("0", "", size) if found is None else (f"{found.counts.total()}", f"{_until_s(found):.3f}", size)
    if rule is None:
        return LogState((*cells, "complete"), None)
    if read != path:
        return LogState((*cells, f"damaged: {rule}"), f"is damaged: {rule}; {read.name} replaces it")
    if (follower := _follower(path)) is not None:
        return LogState((*cells, f"cut off, {follower} goes on: {rule}"), None)
    if is_being_written(path):
        return LogState((*cells, "still being written"), "is still being written: the run is going on")
    nothing = found is None or not found.counts
    remedy = "nothing to recover" if nothing else "see tis recover"
    if path.name == folder.MERGED_FILE:
        remedy = "tis merge writes it again"
    held = "" if found is None or nothing else f", readable up to {_until_s(found):.3f} s"
    return LogState((*cells, f"damaged, {remedy}: {rule}"), f"is damaged: {rule}{held}; {remedy}")


def _recovered(path: Path) -> LogState:
    """Return the state of a recovered log, with its gaps."""
    found = describe(path)
    unknown = Coverage.of(found.log, found.last_ns).unknown
    text = f"recovered: {spans_text(unknown, '')}" if unknown else "recovered, nothing lost"
    return LogState((f"{found.counts.total()}", f"{_until_s(found):.3f}", _size_kb(path), text), None)


def _size_kb(path: Path) -> str:
    return f"{path.stat().st_size / 1000:.0f}"


def _until_s(found: Described) -> float:
    return found.last_ns / NS_PER_S
