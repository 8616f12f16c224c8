"""The command line ``tis``: thin commands; what they do lies in the modules they call."""

import sys
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape

import common
from common import scenario_io
from common.channels import Side
from common.errors import (
    EXIT_INVALID_RUN,
    EXIT_OK,
    Fault,
    InputError,
)
from common.runtime.side import SideOptions
from common.runtime.side_cli import RunSide, side_command
from common.runtime.status import Status
from common.runtime.zenoh_cli import CfgOption, ConfigOption
from common.scenario import Scenario
from common.scenario.network import NetworkPart
from deploy.bench_cli import app as bench_app
from deploy.guard import ERR, OUT, guarded
from deploy.log_cli import RunDirArg
from deploy.log_cli import app as log_app
from deploy.net.profiles import library
from deploy.net_cli import app as net_app
from deploy.report_cli import app as report_app
from deploy.resolve import resolve, scenario_path, shipped_names
from netem.bridge_command import netem_command

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
)

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


def _show_version(asked: bool) -> None:
    if asked:
        OUT.print(f"tis {version('tis-testbed')}, eclipse-zenoh {version('eclipse-zenoh')}", highlight=False)
        raise typer.Exit


@app.callback()
def tis(
    version_: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Run a surgeon, a bad network and a patient, each a process of its own, over Zenoh."""


app.add_typer(bench_app, name="bench")
app.add_typer(net_app, name="net")
app.add_typer(log_app)
app.add_typer(report_app)


@app.command()
@guarded
def run(
    scenario: ScenarioArg,
    settings: SetOption = None,
    seed: SeedOption = None,
    duration_s: DurationOption = None,
    run_dir: RunDirOption = None,
    report: ReportOption = True,
    merge: MergeOption = True,
    view: Annotated[bool, typer.Option("--view", help="Open a live page beside the run, and print its URL.")] = False,
    address: AddressOption = "127.0.0.1",
    port: PortOption = 0,
    hosts: HostOption = None,
) -> int:
    """Run a scenario live: three processes on this machine, in real time."""
    from deploy.live import run_live
    from deploy.view.beside import PageAt

    page = PageAt(address, port, tuple(hosts or ())) if view else None
    return run_live(resolve(scenario, settings or (), seed, duration_s), run_dir, OUT, ERR, report, page, merge)


@app.command()
@guarded
def view(
    west: Annotated[
        str, typer.Option("--west", "-w", metavar="ENDPOINT", help="netem on the surgeon's network.")
    ] = "tcp/127.0.0.1:7447",
    east: Annotated[
        str, typer.Option("--east", "-e", metavar="ENDPOINT", help="netem on the patient's network.")
    ] = "tcp/127.0.0.1:7448",
    prefix: Annotated[str, typer.Option(help="What the emulator goes by: the scenario's session.")] = "tis",
    address: AddressOption = "127.0.0.1",
    port: PortOption = 0,
    hosts: HostOption = None,
    wait_s: Annotated[
        float | None,
        typer.Option("--wait-s", help="Give up when netem is not there after so long; never when not given."),
    ] = None,
    config: ConfigOption = None,
    cfg: CfgOption = None,
) -> int:
    """Open a live page on a run that is under way or to come: movement, delays, losses, the network's controls."""
    from common.runtime.zenoh_session import ZenohOptions
    from deploy.view.attach import attach_page
    from deploy.view.beside import PageAt

    page, zenoh = PageAt(address, port, tuple(hosts or ())), ZenohOptions(config=config, cfg=tuple(cfg or ()))
    return attach_page((west, east), prefix, zenoh, page, wait_s, ERR)


@app.command()
@guarded
def twin(
    scenario: ScenarioArg,
    settings: SetOption = None,
    seed: SeedOption = None,
    duration_s: DurationOption = None,
    run_dir: RunDirOption = None,
    against: Annotated[
        Path | None, typer.Option(metavar="RUN_DIR", help="Compare every packet's fate with this live run's.")
    ] = None,
    report: ReportOption = True,
    merge: MergeOption = True,
) -> int:
    """Run the same three sides in virtual time: as fast as it goes, bit-equal from run to run."""
    from deploy.virtual import run_virtual

    chosen = resolve(scenario, settings or (), seed, duration_s)
    return run_virtual(chosen, run_dir, against, OUT, ERR, report, merge)


@app.command()
@guarded
def replay(run_dir: RunDirArg) -> int:
    """Feed a run's recorded arrivals to its patient again and compare the estimates bit for bit."""
    from deploy.replay import replay as replay_run

    found = replay_run(run_dir)
    OUT.print(str(found), soft_wrap=True)
    for text in found.changed:
        ERR.print(escape(f"warning: {text}"), style="yellow", soft_wrap=True)
    if found.damage is not None:
        ERR.print(escape(f"tis: {run_dir}: patient: {found.damage}; only what is there was replayed"), soft_wrap=True)
    return EXIT_OK if found.identical else EXIT_INVALID_RUN


@app.command()
@guarded
def validate(
    scenario: Annotated[
        str | None,
        typer.Argument(metavar="SCENARIO", help="A scenario file (YAML), or the name of a shipped one."),
    ] = None,
    schema: Annotated[bool, typer.Option("--schema", help="Print the JSON Schema of scenarios.")] = False,
    settings: SetOption = None,
    seed: SeedOption = None,
    duration_s: DurationOption = None,
) -> int:
    """Check a scenario, the traces that it names too, and print it with all defaults."""
    if schema:
        print(scenario_io.schema_json())  # noqa: T201
        return EXIT_OK
    from deploy.validate import check_network

    if scenario is None:
        names = ", ".join(shipped_names())
        raise InputError(Fault("tis validate", "SCENARIO", f"is required: a file, or one of {names}"))
    resolved = resolve(scenario, settings or (), seed, duration_s)
    check_network(resolved, scenario)
    for text in resolved.surgeon.warnings():
        ERR.print(f"warning: {text}", style="yellow", soft_wrap=True)
    print(scenario_io.dump_scenario(resolved), end="")  # noqa: T201
    return EXIT_OK


@app.command()
@guarded
def identify(
    scenario: ScenarioArg,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Write the model to this file (.json).")] = None,
    figure: Annotated[
        Path | None,
        typer.Option(help="Draw the singular values, the order rules and the validation (.svg, .pdf or .png)."),
    ] = None,
    settings: SetOption = None,
    seed: SeedOption = None,
) -> int:
    """Identify the arm's model from a scenario's training data; the file serves as identification.train."""
    from deploy.identify import identify_and_print

    return identify_and_print(resolve(scenario, settings or (), seed), out, figure, OUT, ERR)


@app.command()
@guarded
def summarize(run_dir: RunDirArg) -> int:
    """Compute a run's summary from its logs: for logs gathered from several hosts, or of a run cut short."""
    from deploy.conclude import conclude_again
    from deploy.standalone.command import summarize as summarize_netem
    from deploy.standalone.run import is_standalone

    if is_standalone(run_dir):
        return summarize_netem(run_dir, OUT)
    return conclude_again(run_dir, OUT)


@app.command()
@guarded
def paper(
    path: Annotated[
        str | None, typer.Option(help="Folder of JIGSAWS; TIS_JIGSAWS, or else data/jigsaws, when not given.")
    ] = None,
    task: Annotated[str, typer.Option(help="Task of the trial.")] = "Suturing",
    trial: Annotated[str, typer.Option(help="Subject and repetition.")] = "D002",
    seed: Annotated[int, typer.Option(min=0, help="Decides every random number.")] = 7,
    out: Annotated[Path, typer.Option("--out", "-o", help="The page to write.")] = Path("docs/paper.md"),
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes; all cores when not given.")] = None,
) -> int:
    """Compute the paper's tables again, in virtual time, and write them beside the paper's own as a page."""
    from deploy.paper.cells import Trial
    from deploy.paper.command import write_paper

    return write_paper(Trial(path, task, trial, seed), out, jobs, OUT, ERR)


@app.command()
@guarded
def compare(
    scenario: Annotated[
        str | None,
        typer.Argument(metavar="SCENARIO", help="A scenario file (YAML), or the name of a shipped one."),
    ] = None,
    estimators: Annotated[
        str | None,
        typer.Option(metavar="A,B,C", help="Estimators, by name or module:factory; the scenario's when not given."),
    ] = None,
    trials: Annotated[
        str | None, typer.Option(metavar="D001,E003", help="Trials of the task; all in the folder when not given.")
    ] = None,
    seeds: Annotated[
        int | None, typer.Option(min=1, help="Seeds for each trial (1), or of a synthetic source (5).")
    ] = None,
    sweep: Annotated[
        str | None, typer.Option(metavar="a.b=V,V,...", help="One field of the scenario at several values.")
    ] = None,
    settings: SetOption = None,
    seed: SeedOption = None,
    duration_s: Annotated[
        float | None, typer.Option(help="At most so much of each trial, in s; all of it when not given.")
    ] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes; all cores when not given.")] = None,
    out_dir: Annotated[
        Path | None,
        typer.Option("--out", help="Folder of the results, where a second call goes on; below runs/ when not given."),
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the table to this file as well.")] = None,
    page: Annotated[
        Path | None, typer.Option(help="Instead: compute and write the page on estimators, docs/estimators.md.")
    ] = None,
) -> int:
    """Compare estimators on the same arrivals, over trials, seeds and networks, in virtual time.

    Recorded trials are estimated with models of the other subjects, where
    there are any, whatever the scenario's identification.train says, unless
    that names a model file. To train on the first rows of each trial instead:
    --set identification.train=own_head.
    """
    from deploy.compare.options import compare_or_page

    asked: dict[str, Any] = {"scenario": scenario, "estimators": estimators, "trials": trials, "n_seeds": seeds}
    asked |= {"sweep": sweep, "settings": settings, "seed": seed, "duration_s": duration_s}
    return compare_or_page(asked, page, out_dir, json_file, jobs, OUT, ERR)


@app.command()
@guarded
def synth(
    out_dir: Annotated[
        Path | None, typer.Argument(metavar="OUT_FOLDER", help="A new or empty folder for the trials.")
    ] = None,
    trials: Annotated[int, typer.Option(help="How many trials to write: S001, S002, ...")] = 5,
    task: Annotated[str, typer.Option(help="The task to name them after; the movement is that of suturing.")] = (
        "Suturing"
    ),
    seed: Annotated[int, typer.Option(help="Decides the movements.")] = 1,
    duration_s: Annotated[float, typer.Option(help="Length of a trial, in s.")] = 90.0,
    check: Annotated[
        bool, typer.Option("--check", help="Print how near the movement's statistics are to recorded suturing.")
    ] = False,
) -> int:
    """Write trials of the synthetic surgeon in the format and the folders of JIGSAWS, or check its calibration."""
    from deploy.run_dir import command_line
    from deploy.synth import print_calibration, write_trials

    if out_dir is None and not check:
        raise InputError(Fault("tis synth", "OUT_FOLDER", "is required, or --check"))
    if out_dir is not None:
        files = write_trials(out_dir, trials, task, seed, duration_s, command_line())
        OUT.print(
            escape(f"{len(files)} synthetic trials in {out_dir}; play one with\n")
            + escape(f"source: {{kind: jigsaws, path: {out_dir}, task: {task}, trial: S001}}"),
            soft_wrap=True,
        )
    return print_calibration(seed, OUT) if check else EXIT_OK


def _close_folder(run_dir: Path, network: NetworkPart, exit_code: int) -> None:
    """End the folder of a standalone netem; the module loads when it is used."""
    from deploy.standalone.command import close_folder

    close_folder(run_dir, network, exit_code)


def _side_of(side: Side, module: str) -> RunSide:
    """Return what runs one side; its module loads when it is used."""

    def run_side(scenario: Scenario, options: SideOptions, status: Status) -> int:
        code: int = getattr(import_module(module), f"run_{side}")(scenario, options, status)
        return code

    return run_side


app.command("surgeon")(side_command("surgeon", _side_of("surgeon", "surgeon_side.__main__"), scenario_path, library))
app.command("netem")(netem_command(_side_of("netem", "netem.__main__"), scenario_path, library, _close_folder))
app.command("patient")(side_command("patient", _side_of("patient", "patient_side.__main__"), scenario_path, library))


def _check_own_packages() -> None:
    """Refuse to run with another package named ``common``, which is a common name."""
    expected = Path(__file__).resolve().parents[1] / "common"
    found = Path(common.__file__).resolve().parent
    if found != expected:
        raise InputError(Fault("tis", "common", f"must be the testbed's own package in {expected}", str(found)))


def main() -> Any:
    """Run the command line."""
    try:
        _check_own_packages()
    except InputError as error:
        ERR.print(f"tis: {error}", style="red")
        sys.exit(error.exit_code)
    app()


if __name__ == "__main__":
    main()
