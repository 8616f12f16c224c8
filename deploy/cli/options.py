"""Arguments and options shared by several groups of commands."""

from pathlib import Path
from typing import Annotated, Final

import typer

_SCENARIO: Final = typer.Argument(
    metavar="SCENARIO", help="A scenario file (YAML), or the name of a shipped scenario."
)
ScenarioArg = Annotated[str, _SCENARIO]
OptionalScenarioArg = Annotated[str | None, _SCENARIO]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="a.b=VALUE", help="Override a value (YAML); null removes an optional one."),
]
SeedOption = Annotated[int | None, typer.Option(help="Override the seed.")]
DurationOption = Annotated[float | None, typer.Option(help="Override the duration, in s.")]
RunDirOption = Annotated[Path | None, typer.Option(help="Folder for the run; by default a new one below runs/.")]
ReportOption = Annotated[bool, typer.Option("--report/--no-report", help="Write report.html at the end.")]
AddressOption = Annotated[
    str, typer.Option(help="Address of the live page; any address but loopback requires a token.")
]
PortOption = Annotated[int, typer.Option(min=0, max=65535, help="Port of the live page; 0: any free port.")]
HostOption = Annotated[
    list[str] | None,
    typer.Option("--host", metavar="NAME", help="Another name of this host under which the live page may be opened."),
]
MergeOption = Annotated[bool, typer.Option("--merge/--no-merge", help="Merge the logs into run.mcap at the end.")]
RunDirArg = Annotated[Path, typer.Argument(metavar="RUN_DIR", help="Folder of a run.")]
VerboseOption = Annotated[bool, typer.Option("--verbose", "-v", help="Print all tables instead of the main figures.")]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print the data as JSON on standard output, and words on standard error.")
]
JobsOption = Annotated[int | None, typer.Option(min=1, help="Processes; by default one per core.")]
SchedulerOption = Annotated[
    str | None, typer.Option(metavar="tcp://HOST:8786", help="Compute on the workers of this Dask scheduler instead.")
]
