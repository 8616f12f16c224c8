"""`tis info`: what a run folder holds."""

from collections.abc import Sequence
from pathlib import Path
from typing import get_args

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from common.channels import Side
from common.errors import EXIT_OK, DataError
from common.units import NS_PER_S
from deploy import run_dir as folder
from deploy.conclude import scenario_in
from deploy.logs.describe import describe
from deploy.report.load import load_run
from deploy.report.table import print_summary


def print_info(run_dir: Path, out: Console, err: Console) -> int:
    """Print the summary when there is one, and the state of each log; raises `DataError`.

    A log that is missing is said so, and is no error: the folder may be one host's.
    """
    logs = load_run(run_dir, wanted=())
    folder.read_scenario(run_dir, scenario_in(logs))
    summary = folder.read_json(run_dir / folder.SUMMARY_FILE)
    if summary is None:
        out.print(
            "no summary.json: the run was cut short, or its logs come from several hosts; see tis summarize",
            soft_wrap=True,
        )
    else:
        print_summary(summary, out)
    print_files(run_dir, (*(f"{side}.mcap" for side in get_args(Side)), folder.MERGED_FILE), out, err)
    return EXIT_OK


def print_files(run_dir: Path, names: Sequence[str], out: Console, err: Console) -> None:
    """Print how the run was started, and the length and state of each log of those names."""
    manifest = folder.read_json(run_dir / folder.MANIFEST_FILE)
    if manifest is not None:
        versions = ", ".join(f"{name} {version}" for name, version in manifest["versions"].items())
        out.print(f"command {manifest['command']}, revision {manifest['git_revision'] or 'unknown'}, {versions}")
    table = Table(title="Logs", title_justify="left")
    for name in ("log", "messages", "until s", "size kB", "state"):
        table.add_column(name, justify="left" if name in ("log", "state") else "right")
    for name in names:
        path = run_dir / name
        if path.is_file():
            table.add_row(name, *_state(path))
        elif name == folder.MERGED_FILE:
            table.add_row(name, "", "", "", "not there, see tis merge")
        else:
            table.add_row(name, "", "", "", "missing")
            err.print(escape(f"tis: {run_dir}: {name} is missing"), style="red", soft_wrap=True)
    out.print(table)


def _state(path: Path) -> tuple[str, str, str, str]:
    size = f"{path.stat().st_size / 1000:.0f}"
    try:
        found = describe(path)
    except DataError as error:
        return "0", "", size, f"damaged, see tis recover: {error.faults[0].rule}"
    damage = found.log.damage
    state = "complete" if damage is None else f"damaged, see tis recover: {damage}"
    return str(found.counts.total()), f"{found.last_ns / NS_PER_S:.3f}", size, state
