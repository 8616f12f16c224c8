"""Arguments and options that several groups of commands share."""

from pathlib import Path
from typing import Annotated

import typer

ScenarioArg = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="A scenario file (YAML), or the name of a shipped one.")
]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="a.b=VALUE", help="Override a value (YAML); null removes what can be left out."),
]
SeedOption = Annotated[int | None, typer.Option(help="Override the seed.")]
DurationOption = Annotated[float | None, typer.Option(help="Override the duration, in s.")]
RunDirOption = Annotated[Path | None, typer.Option(help="Folder for the run; a new one below runs/ when not given.")]
ReportOption = Annotated[bool, typer.Option("--report/--no-report", help="Write report.html at the end.")]
AddressOption = Annotated[
    str, typer.Option(help="The live page's address; one that is not loopback asks for a token.")
]
PortOption = Annotated[int, typer.Option(min=0, max=65535, help="The live page's port; 0: any free one.")]
HostOption = Annotated[
    list[str] | None,
    typer.Option("--host", metavar="NAME", help="A further name of this host by which the live page is opened."),
]
MergeOption = Annotated[bool, typer.Option("--merge/--no-merge", help="Merge the logs into run.mcap at the end.")]
RunDirArg = Annotated[Path, typer.Argument(metavar="RUN_DIR", help="Folder of a run.")]
