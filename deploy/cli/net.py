"""``tis net``: the profile library, what a network may hold, the probe and its far end, the fit."""

from pathlib import Path
from typing import Annotated, Any, get_args

import typer

from common.errors import DataError, Fault, InputError
from common.runtime.zenoh_cli import CfgOption, ConfigOption
from deploy.cli.net_control import JsonOption
from deploy.cli.net_control import app as control_app
from deploy.shell.guard import ERR, OUT, guarded

app = typer.Typer(
    no_args_is_help=True,
    help="Networks: profiles, stages, probe, reflect, fit; a running one: show, set, outage, reset.",
)

app.add_typer(control_app)


@app.callback()
def net() -> None:
    """Networks: profiles, stages, probe, reflect, fit; a running one: show, set, outage, reset."""


@app.command()
@guarded
def profiles(
    name: Annotated[
        str | None, typer.Argument(metavar="NAME", help="A profile, or a file (.yaml): print all of it.")
    ] = None,
    as_json: JsonOption = False,
) -> int:
    """List the profile library with what its models amount to, or show one profile with its sources."""
    from deploy.net.library.library_command import list_profiles, show_profile

    return list_profiles(OUT, as_json) if name is None else show_profile(name, OUT, as_json)


@app.command()
@guarded
def stages(
    name: Annotated[
        str | None, typer.Argument(metavar="NAME", help="A stage, or rules, outages, states, timeline: explain it.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="PAGE.md", help="Write all of it as a page instead.")
    ] = None,
) -> int:
    """List what a network may hold: stages, their kinds and parameters, and what changes them in time."""
    from deploy.net.library.stages_command import print_stages, write_page

    return print_stages(name, OUT) if out is None else write_page(out, OUT)


@app.command()
@guarded
def probe(
    connect: Annotated[
        str | None,
        typer.Option(
            "--connect",
            "-e",
            metavar="ENDPOINT",
            help="Both ends connect here, to one router; with --reflector the one end that is here.",
        ),
    ] = None,
    from_end: Annotated[
        str | None, typer.Option("--from", metavar="ENDPOINT", help="Where the sending end connects.")
    ] = None,
    to_end: Annotated[
        str | None,
        typer.Option(
            "--to",
            metavar="ENDPOINT",
            help="Where the receiving end connects, without crossing the path that is measured.",
        ),
    ] = None,
    listen: Annotated[
        str | None,
        typer.Option(
            "--listen",
            "-l",
            metavar="ENDPOINT",
            help="The receiving end listens here, as a router; with --reflector the one end that is here.",
        ),
    ] = None,
    reflector: Annotated[
        bool,
        typer.Option("--reflector", help="The receiving end is a `tis net reflect` on another host, with its clock."),
    ] = False,
    config: ConfigOption = None,
    cfg: CfgOption = None,
    key: Annotated[str, typer.Option(help="Key to send on; a netem between must forward it.")] = "tis/net/probe",
    rate_hz: Annotated[float, typer.Option(min=0.1, max=20_000, help="Messages a second.")] = 100.0,
    count: Annotated[int | None, typer.Option(min=2, max=5_000_000, help="How many messages.")] = None,
    seconds: Annotated[
        float | None, typer.Option(min=0.01, max=86_400, help="For how long; 10 s if nothing.")
    ] = None,
    size: Annotated[int, typer.Option(min=0, max=10_000_000, help="Payload bytes of each.")] = 64,
    timeout_s: Annotated[
        float, typer.Option("--timeout-s", min=0.01, max=3600, help="What comes later than this counts as lost.")
    ] = 5.0,
    wait_s: Annotated[float, typer.Option(min=0.1, help="Give up when nothing comes through in so many s.")] = 10.0,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="TRACE.csv", help="Write the trace there; what is there is replaced."),
    ] = None,
    as_json: JsonOption = False,
) -> int:
    """Measure delay, jitter, loss and their correlation through a Zenoh path.

    To another host: `tis net reflect -l tcp/0.0.0.0:7447` there, and here
    `tis net probe -e tcp/THERE:7447 --reflector`. The delay is one way. The
    clocks are compared over the same path: each delay is uncertain by half the
    shortest round trip, since an unequal path looks like an offset. Losses are
    as sure as on one host, and so is the variation, but for the clocks' drift.

    Without --reflector both ends are in this process, on one clock: exact, but
    one way only if --to is reached without crossing the path again. Otherwise
    it is the delay of the way there and back.
    """
    from common.runtime.zenoh_session import ZenohOptions
    from deploy.net.probing.ends import Ends
    from deploy.net.probing.probe import Plan
    from deploy.net.probing.probe_command import probe_and_print

    if count is not None and seconds is not None:
        raise InputError(Fault("tis net probe", "--seconds", "must not be given beside --count"))
    n_messages = count if count is not None else max(2, round((seconds or 10.0) * rate_hz))
    ends = Ends.of(connect, from_end, to_end, listen, reflector)
    plan = Plan(key, rate_hz, n_messages, size, timeout_s, wait_s)
    return probe_and_print(ends, ZenohOptions((), (), config, cfg or ()), plan, out, OUT, ERR, as_json)


@app.command()
@guarded
def reflect(
    connect: Annotated[
        str | None, typer.Option("--connect", "-e", metavar="ENDPOINT", help="Connect here, to a router.")
    ] = None,
    listen: Annotated[
        str | None, typer.Option("--listen", "-l", metavar="ENDPOINT", help="Listen here, as a router.")
    ] = None,
    config: ConfigOption = None,
    cfg: CfgOption = None,
    key: Annotated[
        str, typer.Option(help="The probe's key; its clock and its stamps are asked for below it.")
    ] = "tis/net/probe",
    wait_s: Annotated[float, typer.Option(min=0.1, help="Give up when no router is there after so many s.")] = 10.0,
) -> int:
    """Be the far end of `tis net probe --reflector`, until Ctrl-C: stamp what arrives and hand the stamps back.

    Each arrival is stamped by this host's own clock, which nobody needs to synchronise.
    """
    from common.runtime.zenoh_session import ZenohOptions
    from deploy.net.probing.reflect_command import reflect_until_told

    return reflect_until_told(connect, listen, ZenohOptions((), (), config, cfg or ()), key, wait_s, ERR)


@app.command()
@guarded
def fit(
    source: Annotated[Path, typer.Argument(metavar="TRACE.csv|RUN_DIR", help="A trace, or a run with netem's log.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="PROFILE.yaml", help="Write a profile there; what is there is replaced."),
    ] = None,
    name: Annotated[str | None, typer.Option(help="Its name; the file's when not given.")] = None,
    way: Annotated[
        str, typer.Option(help="Which way a trace stands for: forward, feedback or both; a run has its own.")
    ] = "both",
    distribution: Annotated[
        str, typer.Option(help="auto: the best family, or quantiles; or one of them by name.")
    ] = "auto",
    as_json: JsonOption = False,
) -> int:
    """Fit delay, correlation and loss to a record, and write them as a profile."""
    from deploy.net.fitting.fit import Ways
    from deploy.net.fitting.fit_command import fit_and_print
    from netem.fit.marginal import MarginalName

    for option, value, allowed in (
        ("--way", way, get_args(Ways)),
        ("--distribution", distribution, ("auto", *get_args(MarginalName))),
    ):
        if value not in allowed:
            raise InputError(Fault("tis net fit", option, f"must be one of {', '.join(allowed)}", value))
    if not source.exists():
        raise DataError(Fault(str(source), "", "is not there"))
    chosen: Any = None if distribution == "auto" else distribution
    return fit_and_print(source, out, name, way, chosen, OUT, ERR, as_json)  # type: ignore[arg-type]
