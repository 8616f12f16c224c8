"""`tis info`: what a run folder holds."""

from pathlib import Path

from rich.console import Console
from rich.table import Table

from common.errors import EXIT_OK
from deploy import run_dir as folder
from deploy.conclude import scenario_in
from deploy.report.load import load_run
from deploy.report.table import print_summary


def print_info(run_dir: Path, out: Console) -> int:
    """Print the summary when there is one, and the state of each log; raises `DataError`."""
    logs = load_run(run_dir)
    folder.read_scenario(run_dir, scenario_in(logs))
    summary = folder.read_json(run_dir / folder.SUMMARY_FILE)
    if summary is None:
        out.print(
            "no summary.json: the run was cut short, or its logs come from several hosts; see tis summarize",
            soft_wrap=True,
        )
    else:
        print_summary(summary, out)
    manifest = folder.read_json(run_dir / folder.MANIFEST_FILE)
    if manifest is not None:
        versions = ", ".join(f"{name} {version}" for name, version in manifest["versions"].items())
        out.print(f"command {manifest['command']}, revision {manifest['git_revision'] or 'unknown'}, {versions}")
    table = Table(title="Logs", title_justify="left")
    for name in ("log", "messages", "until s", "size kB", "state"):
        table.add_column(name, justify="left" if name in ("log", "state") else "right")
    for side, log in logs.sides.items():
        size = (run_dir / f"{side}.mcap").stat().st_size / 1000
        state = "complete" if log.damage is None else f"damaged, see tis recover: {log.damage}"
        table.add_row(f"{side}.mcap", str(log.n_messages), f"{log.last_ns * 1e-9:.3f}", f"{size:.0f}", state)
    out.print(table)
    return EXIT_OK
