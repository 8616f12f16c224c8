"""Groups of commands: help in sections, 80 columns wide, and options that are not given twice."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from typer.core import TyperCommand, TyperGroup

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
EstimatorsOption = Annotated[
    str | None, typer.Option(metavar="A,B,C", help="Estimators by name or module:factory; by default the scenario's.")
]
TrialsOption = Annotated[
    str | None, typer.Option(metavar="D001,E003", help="Trials of the task; by default all in the folder.")
]
TrialDurationOption = Annotated[
    float | None, typer.Option(help="Use at most this much of each trial, in s; by default all of it.")
]
StudyFolderOption = Annotated[
    Path | None,
    typer.Option("--out", help="Folder of the results, by default below runs/; a second call resumes there."),
]
JobsOption = Annotated[int | None, typer.Option(min=1, help="Processes; by default one per core.")]
SchedulerOption = Annotated[
    str | None, typer.Option(metavar="tcp://HOST:8786", help="Compute on the workers of this Dask scheduler instead.")
]


SECTIONS: Final = (
    "Run",
    "Run on several hosts",
    "Look at runs",
    "Scenarios and data",
    "Studies",
    "Networks",
    "One side, on a host of its own",
)
"""Sections of `tis --help`, in their order."""

_OPTIONS: Final = "Options"
_KINDS: Final = {"str": "TEXT", "path": "PATH", "int": "N", "float": "NUMBER"}
_WIDTH: Final = 80
_NAME_WIDTH: Final = 28

CONTEXT: Final = {"help_option_names": ["-h", "--help"], "max_content_width": _WIDTH}


class OneCommand(TyperCommand):
    """A command whose options stand once each on its command line, unless an option takes several values."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the command line; raise `typer.BadParameter` for an option that would silently replace itself."""
        if not ctx.resilient_parsing:
            _, _, given = self.make_parser(ctx).parse_args(args=list(args))
            for option in self.params:
                once = option.param_type_name == "option" and not option.multiple
                if once and sum(each is option for each in given) > 1:
                    names = " / ".join((*option.opts, *option.secondary_opts))
                    raise typer.BadParameter("is given more than once", ctx, param_hint=names)
        return super().parse_args(ctx, args)

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return the parts of the usage line, without typer's braces around what is required."""
        return [piece.replace("{", "").replace("}", "") for piece in super().collect_usage_pieces(ctx)]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments and options, each panel of options as a section."""
        records: dict[str, list[tuple[str, str]]] = {}
        for param in self.get_params(ctx):
            record = param.get_help_record(ctx)
            if record is not None:
                named = param.param_type_name == "argument"
                heading = "Arguments" if named else _panel_of(param) or _OPTIONS
                name = record[0].partition(" <")[0] if named else _plain(record[0])
                records.setdefault(heading, []).append((name, record[1]))
        for heading, rows in records.items():
            with formatter.section(heading):
                formatter.write_dl(rows, col_max=_NAME_WIDTH)


class CommandGroup(TyperGroup):
    """A group that lists its commands in sections, each with one line or more of what it does."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands, each panel as a section, with the first paragraph of each help in full."""
        sections: dict[str, list[tuple[str, str]]] = {}
        for name in self.list_commands(ctx):
            command = self.get_command(ctx, name)
            if command is not None and not command.hidden:
                row = name, _first_paragraph(command.help)
                sections.setdefault(_panel_of(command) or "Commands", []).append(row)
        for heading in sorted(sections, key=lambda one: SECTIONS.index(one) if one in SECTIONS else len(SECTIONS)):
            with formatter.section(heading):
                formatter.write_dl(sections[heading])

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the commands, then the group's own options."""
        self.format_commands(ctx, formatter)
        rows = [record for param in self.get_params(ctx) if (record := param.get_help_record(ctx)) is not None]
        with formatter.section(_OPTIONS):
            formatter.write_dl([(_plain(name), text) for name, text in rows], col_max=_NAME_WIDTH)


class Commands(typer.Typer):
    """A typer app with commands of these kinds; ``panel`` is the section of the help in which they stand."""

    def __init__(self, panel: str | None = None, **options: Any) -> None:
        super().__init__(cls=CommandGroup, rich_markup_mode=None, context_settings=CONTEXT, **options)
        self._panel = panel

    def command(self, name: str | None = None, **options: Any) -> Callable[[Any], Any]:
        """Register a command, as `typer.Typer.command` does."""
        options.setdefault("rich_help_panel", self._panel)
        return super().command(name, cls=OneCommand, **options)


def _panel_of(one: Any) -> str | None:
    panel = getattr(one, "rich_help_panel", None)
    return panel if isinstance(panel, str) else None


def _plain(name: str) -> str:
    """Return an option's name with its value as a word: ``--seed N`` instead of ``--seed <int range>``."""

    def word(found: re.Match[str]) -> str:
        kind = _KINDS.get(found["one"] or found["many"], "TEXT")
        return f" {kind}..." if found["many"] else f" {kind}"

    return re.sub(r" <(?:list\[(?P<many>\w+)\]|(?P<one>\w+)(?: range)?)>", word, name)


def _first_paragraph(text: str | None) -> str:
    return " ".join((text or "").split("\n\n")[0].split())
