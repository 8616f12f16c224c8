"""Groups of commands: help in sections, 80 columns wide, options given once, and those that many commands share."""

import inspect
import re
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup

from tis.common.runtime.side_cli import CfgOption, ConfigOption, InsecureOption
from tis.deploy.cli import completion
from tis.deploy.shell.guard import ERR, QUIET, guarded, words_to

if TYPE_CHECKING:
    from rich.console import Console

    from tis.common.runtime.emulator_client import EmulatorAddress
    from tis.common.runtime.zenoh_session import ZenohOptions
    from tis.common.scenario import Scenario
    from tis.deploy.run.conclude import Outputs
    from tis.deploy.view.page_process import PageAddress

_SCENARIO: Final = typer.Argument(
    metavar="SCENARIO",
    help="A scenario file (YAML), or the name of a shipped scenario (tis scenarios).",
    autocompletion=completion.scenarios,
)
ScenarioArg = Annotated[str, _SCENARIO]
OptionalScenarioArg = Annotated[str | None, _SCENARIO]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="a.b=VALUE", help="Override a value (YAML); null removes an optional one."),
]
SeedOption = Annotated[int | None, typer.Option(help="Override the seed.")]
RunDirOption = Annotated[Path | None, typer.Option(help="Folder for the run; by default a new one below runs/.")]
RunDirArg = Annotated[Path, typer.Argument(metavar="RUN_DIR", help="Folder of a run.")]
PrefixOption = Annotated[
    str | None,
    typer.Option(
        help="Prefix of the emulator's control keys: the scenario's session; by default that of the run here."
    ),
]
VerboseOption = Annotated[bool, typer.Option("--verbose", "-v", help="Print all tables instead of the main figures.")]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print the data as JSON on standard output, and words on standard error.")
]
EstimatorsOption = Annotated[
    str | None,
    typer.Option(
        metavar="A,B,C",
        help="Estimators by name or module:factory; by default the scenario's.",
        autocompletion=completion.estimators,
    ),
]
TrialsOption = Annotated[
    str | None,
    typer.Option(
        metavar="D001,E003",
        help="Trials of the task; by default all in the folder, of a table itself unless train is others.",
    ),
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


@dataclass(frozen=True)
class Options:
    """Options that stand together: a command with a parameter of this type has one option for each field."""


@dataclass(frozen=True)
class ScenarioOptions(Options):
    """A scenario and what overrides it."""

    scenario: ScenarioArg
    settings: SetOption = None
    seed: SeedOption = None
    duration_s: Annotated[float | None, typer.Option(help="Override the duration, in s.")] = None

    def resolve(self) -> "Scenario":
        """Return the scenario; raises `InputError`."""
        from tis.deploy.run.resolve import resolve

        return resolve(self.scenario, self.settings or (), self.seed, self.duration_s)


@dataclass(frozen=True)
class OutputOptions(Options):
    """What a command on a run writes and prints."""

    report: Annotated[bool, typer.Option("--report/--no-report", help="Write report.html at the end.")] = True
    merge: Annotated[bool, typer.Option("--merge/--no-merge", help="Merge the logs into run.mcap at the end.")] = True
    verbose: VerboseOption = False
    as_json: JsonOption = False
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print warnings and errors only, and --json.")] = False

    @property
    def wanted(self) -> "Outputs":
        """Return the wanted outputs."""
        from tis.deploy.run.conclude import Outputs

        return Outputs(self.report, self.merge, self.verbose, self.as_json)

    @property
    def words(self) -> "Console":
        """Return the console for the result."""
        return QUIET if self.quiet else words_to(self.as_json)

    @property
    def progress(self) -> "Console":
        """Return the console for progress, warnings and errors."""
        return QUIET if self.quiet else ERR


@dataclass(frozen=True)
class PageOptions(Options):
    """Where the live page is."""

    address: Annotated[
        str, typer.Option(help="Address of the live page, which needs the token that is printed with it.")
    ] = "127.0.0.1"
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of the live page; 0: any free port.")] = 0
    hosts: Annotated[
        list[str] | None,
        typer.Option(
            "--host", metavar="NAME", help="Another name of this host under which the live page may be opened."
        ),
    ] = None

    @property
    def page(self) -> "PageAddress":
        """Return the page's address."""
        from tis.deploy.view.page_process import PageAddress

        return PageAddress(self.address, self.port, tuple(self.hosts or ()))


@dataclass(frozen=True)
class ConnectionOptions(Options):
    """Zenoh's own options."""

    config: ConfigOption = None
    cfg: CfgOption = None
    insecure: InsecureOption = False

    def zenoh(self, connect: list[str] | None = None, listen: list[str] | None = None) -> "ZenohOptions":
        """Return the options of a session with these endpoints."""
        from tis.common.runtime.zenoh_session import ZenohOptions

        return ZenohOptions(
            tuple(connect or ()), tuple(listen or ()), self.config, tuple(self.cfg or ()), self.insecure
        )


@dataclass(frozen=True)
class EmulatorOptions(Options):
    """Where a running emulator is."""

    connect: Annotated[
        str | None,
        typer.Option(
            "--connect",
            "-e",
            metavar="ENDPOINT",
            help="One of the emulator's networks, west or east; by default the endpoint of --config, "
            "else that of the run on this machine.",
        ),
    ] = None
    prefix: PrefixOption = None
    config: ConfigOption = None
    cfg: CfgOption = None

    @property
    def emulator(self) -> "EmulatorAddress":
        """Return the emulator's address; raises `InputError`."""
        from tis.common.runtime.emulator_client import emulator_address

        return emulator_address(self.connect, self.prefix, self.config, self.cfg)

    @property
    def words(self) -> list[str]:
        """Return the options as they are typed, for a command to the same emulator."""
        prefix = None if self.prefix == "tis" else self.prefix
        given = [("--connect", self.connect), ("--prefix", prefix), *(("--cfg", one) for one in self.cfg or ())]
        given += [("--config", None if self.config is None else str(self.config))]
        return [word for option, value in given if value is not None for word in (option, value)]


def spread(command: Callable[..., int]) -> Callable[..., int]:
    """Return a command whose parameters of `Options` are given as one keyword for each of their fields."""
    parameters, groups = [], {}
    for one in inspect.signature(command, eval_str=True).parameters.values():
        if not (isinstance(one.annotation, type) and issubclass(one.annotation, Options)):
            parameters.append(one.replace(kind=inspect.Parameter.KEYWORD_ONLY))
            continue
        kinds = get_type_hints(one.annotation, include_extras=True)
        groups[one.name] = one.annotation, [field.name for field in fields(one.annotation)]
        for name, field in inspect.signature(one.annotation).parameters.items():
            parameters.append(field.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=kinds[name]))

    @wraps(command)
    def called(**given: Any) -> int:
        for name, (group, names) in groups.items():
            given[name] = group(**{field: given.pop(field) for field in names})
        return command(**given)

    called.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]  # what typer reads
    called.__annotations__ = {one.name: one.annotation for one in parameters}
    return called


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

    def format_epilog(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002
        """Write the example as it is: wrapped it could not be copied."""
        if self.epilog:
            with formatter.section("Example"):
                formatter.write("".join(f"  {line}\n" for line in self.epilog.splitlines()))


class CommandGroup(TyperGroup):
    """A group that lists its commands in sections, each with one line or more of what it does."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands, each panel as a section, with the first paragraph of each help in full."""
        sections: dict[str, list[tuple[str, str]]] = {}
        for name in self.list_commands(ctx):
            command = self.get_command(ctx, name)
            if command is not None and not command.hidden:
                row = name, " ".join((command.help or "").split("\n\n")[0].split())
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
        """Register a command that returns its exit code; errors become lines, `Options` one option for each field."""
        return lambda command: self.register(guarded(spread(command)), name, **options)

    def register(
        self, command: Callable[..., None], name: str | None = None, *, example: str = "", **options: Any
    ) -> Any:
        """Register a command that ends by `typer.Exit`, as `typer.Typer.command` does; ``example`` ends its help."""
        options.setdefault("epilog", example)
        options.setdefault("rich_help_panel", self._panel)
        return super().command(name, cls=OneCommand, **options)(command)


def _panel_of(one: Any) -> str | None:
    panel = getattr(one, "rich_help_panel", None)
    return panel if isinstance(panel, str) else None


def _plain(name: str) -> str:
    """Return an option's name with its value as a word: ``--seed N`` instead of ``--seed <int range>``."""

    def word(found: re.Match[str]) -> str:
        kind = _KINDS.get(found["one"] or found["many"], "TEXT")
        return f" {kind}..." if found["many"] else f" {kind}"

    return re.sub(r" <(?:list\[(?P<many>\w+)\]|(?P<one>\w+)(?: range)?)>", word, name)
