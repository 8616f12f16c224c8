"""Commands on runs: `run`, `view`, `twin`, `replay`, `summarize`."""

from math import isfinite
from pathlib import Path
from typing import Annotated

import typer

from tis.common.errors import EXIT_INVALID_RUN, EXIT_OK
from tis.common.runtime.side_cli import CfgOption, ConfigOption, InsecureOption
from tis.deploy.cli.group import (
    Commands,
    EmulatorOptions,
    JsonOption,
    OutputOptions,
    PageOptions,
    PrefixOption,
    RunDirArg,
    RunDirOption,
    ScenarioOptions,
    VerboseOption,
)
from tis.deploy.shell.guard import ERR, OUT, print_faults, print_json, print_warnings, words_to

app = Commands("Run")


@app.command(example="tis run default --set network.forward.delay.delay_ms=80 --view")
def run(
    *,
    scenario: ScenarioOptions,
    run_dir: RunDirOption = None,
    outputs: OutputOptions,
    view: Annotated[bool, typer.Option("--view", help="Open a live page during the run and print its URL.")] = False,
    at: PageOptions,
    insecure: InsecureOption = False,
    foreign_surgeon: Annotated[
        bool, typer.Option("--foreign-surgeon", help="Another program is the surgeon, by the protocol; needs hosts.")
    ] = False,
) -> int:
    """Run a scenario live, as three processes on this machine in real time."""
    from tis.deploy.run.live import run_live

    page = at.page if view else None
    return run_live(
        scenario.resolve(), run_dir, outputs.words, outputs.progress, outputs.wanted, page, insecure, foreign_surgeon
    )


SecretOption = Annotated[
    Path | None,
    typer.Option(
        "--secret-file",
        help="Sign stops and releases with the run's shared secret; by default with -c's certificate.",
    ),
]


@app.command(example="tis view")
def view(
    *,
    west: Annotated[
        str | None,
        typer.Option(
            "--west",
            metavar="ENDPOINT",
            help="Endpoint of netem on the surgeon's network; by default those of what runs on this machine.",
        ),
    ] = None,
    east: Annotated[
        str | None,
        typer.Option("--east", metavar="ENDPOINT", help="Endpoint of netem on the patient's network."),
    ] = None,
    prefix: PrefixOption = None,
    at: PageOptions,
    wait_s: Annotated[
        float | None, typer.Option("--wait-s", help="Give up without netem within this time, s; by default never.")
    ] = None,
    secret_file: SecretOption = None,
    config: ConfigOption = None,
    cfg: CfgOption = None,
) -> int:
    """Open a live page on a present or future run, or on a `tis netem`: what passes, and the network's controls.

    Of a run it shows movement, delays, losses and errors, too.
    """
    from tis.common.runtime.zenoh_session import ZenohOptions
    from tis.deploy.view.page_process import attach_page

    zenoh = ZenohOptions(config=config, cfg=tuple(cfg or ()))
    return attach_page((west, east), prefix, zenoh, at.page, wait_s, ERR, secret_file)


@app.command(example="tis twin lossy --duration-s 60 --seed 3")
def twin(
    *,
    scenario: ScenarioOptions,
    run_dir: RunDirOption = None,
    against: Annotated[
        Path | None, typer.Option(metavar="RUN_DIR", help="Compare every packet's fate with those of this live run.")
    ] = None,
    outputs: OutputOptions,
) -> int:
    """Run the same three sides in virtual time, faster than real time and bit-equal from run to run."""
    from tis.deploy.run.virtual import run_virtual

    return run_virtual(scenario.resolve(), run_dir, against, outputs.words, outputs.progress, outputs.wanted)


@app.command(example="tis replay RUN_DIR")
def replay(run_dir: RunDirArg, as_json: JsonOption = False) -> int:
    """Replay a run's recorded arrivals through its patient and compare the estimates bit for bit."""
    from tis.deploy.run.replay import replay as replay_run

    found = replay_run(run_dir)
    words_to(as_json).print(str(found), soft_wrap=True)
    if as_json:
        print_json(
            {**vars(found), "largest": found.largest if isfinite(found.largest) else None}
            | {"identical": found.identical, "is_rounding": found.is_rounding}
        )
    print_warnings(ERR, *found.changed)
    if found.damage is not None:
        print_faults(ERR, f"{run_dir}: patient: {found.damage}; only the readable part was replayed")
    return EXIT_OK if found.identical or found.is_rounding else EXIT_INVALID_RUN


def _print_schema(wanted: bool) -> None:
    if wanted:
        from tis.deploy.report.summary import Summary

        print_json(Summary.model_json_schema())
        raise typer.Exit


@app.command(example="tis summarize RUN_DIR")
def summarize(
    run_dir: RunDirArg,
    verbose: VerboseOption = False,
    as_json: JsonOption = False,
    schema: Annotated[  # noqa: ARG001  # its callback does the work
        bool,
        typer.Option(
            "--schema", is_eager=True, callback=_print_schema, help="Print the JSON schema of summary.json and exit."
        ),
    ] = False,
) -> int:
    """Compute a run's summary from its logs: after gathering them from several hosts, or after an aborted run."""
    from tis.deploy.run.conclude import Outputs, conclude_again
    from tis.deploy.standalone.command import summarize as summarize_netem
    from tis.deploy.standalone.standalone_run import is_standalone

    if is_standalone(run_dir):
        return summarize_netem(run_dir, words_to(as_json), as_json)
    return conclude_again(run_dir, words_to(as_json), Outputs(verbose=verbose, as_json=as_json))


@app.command(example='tis stop "a hand in the way"')
def stop(
    *,
    reason: Annotated[
        str, typer.Argument(metavar="REASON|TOKEN", help="Text for the log; with --release what ends one stop.")
    ] = "",
    release: Annotated[
        bool,
        typer.Option("--release", help="End the stop of TOKEN; without TOKEN every stop that this client may end."),
    ] = False,
    secret_file: SecretOption = None,
    at: EmulatorOptions,
) -> int:
    """Stop the arms of a running session now, beside the emulated network, until --release.

    The patient confirms; without a confirmation within 3 s the exit code is 3.
    The arms brake within their acceleration and then stand; estimates go on.
    They move again when every stop in force has been released. A stop prints
    the TOKEN that ends it; a release tells whether the arms are still stopped.
    """
    from tis.common.runtime.process import command_line
    from tis.deploy.net.emergency import Token, release_all, release_one, stop_arms

    address = at.emulator._replace(secret=secret_file)
    signed = [] if secret_file is None else ["--secret-file", str(secret_file)]
    if not release:
        done = stop_arms(address, reason)
        release_it = command_line(["stop", *at.words, *signed, "--release", str(done.token)])
        ending = "" if done.token is None else f"; release it with: {release_it}"
        text = f"{done.text}{ending}"
    elif reason:
        text = release_one(address, Token.parse(reason))
    else:
        text = release_all(address, {})
    OUT.print(text, soft_wrap=True, markup=False, highlight=False)
    return EXIT_OK
