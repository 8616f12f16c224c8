"""Commands on networks: ``tis net``, to look at profiles and stages, measure, fit, and change a running one."""

from pathlib import Path
from typing import Annotated, Any, get_args

import typer

from tis.common.errors import DataError, Fault, InputError
from tis.deploy.cli import completion
from tis.deploy.cli.group import Commands, ConnectionOptions, EmulatorOptions, JsonOption
from tis.deploy.shell.guard import ERR, OUT

app = Commands(
    no_args_is_help=True, help="Inspect, measure and fit networks; change a running one (show, set, outage, reset)."
)


@app.command(example="tis net profiles hospital_wifi")
def profiles(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="NAME",
            help="A profile or a profile file (.yaml) to print in full.",
            autocompletion=completion.profiles,
        ),
    ] = None,
    as_json: JsonOption = False,
) -> int:
    """List the profile library with the figures of its models, or show one profile with its sources."""
    from tis.deploy.net.library import list_profiles, show_profile

    return list_profiles(OUT, as_json) if name is None else show_profile(name, OUT, as_json)


@app.command(example="tis net stages delay")
def stages(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="NAME", help="A stage or kind to explain, or rules, outages, steps, states, timeline."
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="PAGE.md", help="Write the whole reference as a page.")
    ] = None,
) -> int:
    """List the stages of a network with their kinds and parameters, and the sections that change them over time."""
    from tis.deploy.net.library import print_stages, write_page

    return print_stages(name, OUT) if out is None else write_page(out, OUT)


_CommonEndOption = Annotated[
    str | None,
    typer.Option("--connect", "-e", metavar="ENDPOINT", help="Router of both ends (with --reflector: local end)."),
]
_FromOption = Annotated[str | None, typer.Option("--from", metavar="ENDPOINT", help="Connect the sending end here.")]
_ToOption = Annotated[
    str | None,
    typer.Option("--to", metavar="ENDPOINT", help="Connect the receiving end here, off the measured path."),
]
_ListenOption = Annotated[
    str | None,
    typer.Option("--listen", "-l", metavar="ENDPOINT", help="Listen here as receiving end (--reflector: local)."),
]
_ReflectorOption = Annotated[
    bool, typer.Option("--reflector", help="Receive by a `tis net reflect` on another host, with its own clock.")
]
_KeyOption = Annotated[str, typer.Option(help="Key to send on; a netem on the path must forward it.")]
_SecondsOption = Annotated[
    float | None,
    typer.Option("--duration-s", "--seconds", min=0.01, max=86_400, help="Duration, s; 10 without --count."),
]
_TimeoutOption = Annotated[
    float, typer.Option("--timeout-s", min=0.01, max=3600, help="Messages later than this count as lost.")
]
_TraceOption = Annotated[
    Path | None,
    typer.Option("--out", "-o", metavar="TRACE.csv", help="Write the trace here; replaces an existing file."),
]


@app.command(example="tis net probe -e tcp/THERE:7447 --reflector --duration-s 60 -o trace.csv")
def probe(
    *,
    connect: _CommonEndOption = None,
    from_end: _FromOption = None,
    to_end: _ToOption = None,
    listen: _ListenOption = None,
    reflector: _ReflectorOption = False,
    connection: ConnectionOptions,
    key: _KeyOption = "tis/net/probe",
    rate_hz: Annotated[float, typer.Option(min=0.1, max=20_000, help="Messages per second.")] = 100.0,
    count: Annotated[int | None, typer.Option(min=2, max=5_000_000, help="Number of messages.")] = None,
    seconds: _SecondsOption = None,
    size: Annotated[int, typer.Option(min=0, max=10_000_000, help="Payload bytes of each message.")] = 64,
    timeout_s: _TimeoutOption = 5.0,
    wait_s: Annotated[float, typer.Option(min=0.1, help="Give up without an arrival within this time, s.")] = 10.0,
    out: _TraceOption = None,
    as_json: JsonOption = False,
) -> int:
    """Measure delay, jitter, loss and their correlation through a Zenoh path.

    To another host: `tis net reflect -l tcp/0.0.0.0:7447 --insecure` there, and
    here `tis net probe -e tcp/THERE:7447 --reflector`. The delay is one way. The
    clocks are compared over the same path: each delay is uncertain by half the
    shortest round trip, because an asymmetric path looks like a clock offset.
    Loss is exact. Delay variation is exact except for clock drift.

    Without --reflector both ends are in this process, on one clock: exact, but
    one way only if --to is reached without crossing the path again. Otherwise
    the delay includes the way back.
    """
    from tis.deploy.net.ends import Ends
    from tis.deploy.net.probe import Plan
    from tis.deploy.net.probe_command import probe_and_print

    if count is not None and seconds is not None:
        raise InputError(Fault("tis net probe", "--duration-s", "must not be given together with --count"))
    n_messages = count if count is not None else max(2, round((seconds or 10.0) * rate_hz))
    ends = Ends.of(connect, from_end, to_end, listen, reflector)
    plan = Plan(key, rate_hz, n_messages, size, timeout_s, wait_s)
    return probe_and_print(ends, connection.zenoh(), plan, out, OUT, ERR, as_json)


@app.command(example="tis net reflect -l tcp/0.0.0.0:7447 --insecure")
def reflect(
    *,
    connect: Annotated[
        str | None, typer.Option("--connect", "-e", metavar="ENDPOINT", help="Connect to this router.")
    ] = None,
    listen: Annotated[
        str | None, typer.Option("--listen", "-l", metavar="ENDPOINT", help="Listen here as a router.")
    ] = None,
    connection: ConnectionOptions,
    key: Annotated[
        str, typer.Option(help="The probe's key; the clock and the time stamps are served below it.")
    ] = "tis/net/probe",
    wait_s: Annotated[float, typer.Option(min=0.1, help="Give up without a router within this time, s.")] = 10.0,
) -> int:
    """Serve as the far end of `tis net probe --reflector` until Ctrl-C: stamp messages and return the stamps.

    Each arrival is stamped by this host's own clock, which needs no synchronisation.
    """
    from tis.deploy.net.reflector import run_reflector

    return run_reflector(connect, listen, connection.zenoh(), key, wait_s, ERR)


@app.command(example="tis net fit trace.csv -o my_network.yaml")
def fit(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="TRACE|RUN_DIR",
            help="A trace of `tis net probe`, output of ping, JSON of irtt, CSV of round trips, a capture (.pcap), "
            "or a run with netem's log.",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="PROFILE.yaml", help="Write the profile here; replaces an existing file."
        ),
    ] = None,
    received: Annotated[
        Path | None,
        typer.Option(metavar="CAPTURE", help="The receiver's capture beside the sender's (extra pcap)."),
    ] = None,
    name: Annotated[str | None, typer.Option(help="Name of the profile; by default the name of the file.")] = None,
    way: Annotated[
        str, typer.Option(help="Direction that a trace stands for: forward, feedback or both; ignored for a run.")
    ] = "both",
    key: Annotated[
        str | None, typer.Option(help="Key of a run to fit; by default that with most messages, in each direction.")
    ] = None,
    distribution: Annotated[
        str, typer.Option(help="Family to fit by name, or auto: the best one, or quantiles.")
    ] = "auto",
    replays: Annotated[
        int, typer.Option(min=0, max=10_000, help="Replays to compare the fit by; 0: one regime, unchecked.")
    ] = 100,
    as_json: JsonOption = False,
) -> int:
    """Fit delay, correlation, loss, outages and states to a trace or run, and write them as a profile.

    The fit replays itself: printed are mean, quantiles, autocorrelation, the longest run of losses and the seconds
    above 20 % loss of the record, beside those of the replays. What does not close is warned of by name.
    """
    from tis.deploy.net.fit import Ways
    from tis.deploy.net.fit_command import fit_and_print
    from tis.netem.fit.marginal import MarginalName

    for option, value, allowed in (
        ("--way", way, get_args(Ways)),
        ("--distribution", distribution, ("auto", *get_args(MarginalName))),
    ):
        if value not in allowed:
            raise InputError(Fault("tis net fit", option, f"must be one of {', '.join(allowed)}", value))
    for path in (source, received):
        if path is not None and not path.exists():
            raise DataError(Fault(str(path), "", "does not exist"))
    if received is None and source.suffix in (".pcap", ".pcapng", ".cap"):
        raise InputError(Fault("tis net fit", "--received", "must name the receiver's capture beside the sender's"))
    if key is not None and not source.is_dir():
        raise InputError(Fault("tis net fit", "--key", "is of a run folder: a trace has none", key))
    chosen: Any = None if distribution == "auto" else distribution
    return fit_and_print(source, out, name, way, chosen, OUT, ERR, as_json, replays, received, key)  # type: ignore[arg-type]


@app.command(example="tis net show")
def show(at: EmulatorOptions, as_json: JsonOption = False) -> int:
    """Show the current state of a running emulator in both directions."""
    from tis.deploy.net.control import show as show_state

    return show_state(at.emulator, OUT, as_json)


_DirectionArg = Annotated[
    str | None,
    typer.Argument(
        metavar="[forward|feedback|both]", help="forward: west to east; feedback: back. Not with --profile."
    ),
]
_SettingsArg = Annotated[
    list[str] | None,
    typer.Argument(metavar="[a.b=VALUE]...", help="Such as delay.delay_ms=50; `tis net stages` lists them."),
]
_YamlOption = Annotated[
    str | None, typer.Option("--yaml", metavar="TEXT", help="Stages in YAML; a.b=VALUE overrides them.")
]
_ForOption = Annotated[
    str | None, typer.Option("--for-s", "--for", metavar="SECONDS", help="Duration, s; by default permanent.")
]
_RampOption = Annotated[
    str | None,
    typer.Option(
        "--ramp-s",
        "--ramp",
        metavar="SECONDS",
        help="Time in which factors and additions grow, and in which they go back before the end, s.",
    ),
]
_AtOption = Annotated[float | None, typer.Option("--at-s", help="Begin at this run time, s; by default immediately.")]
_ProfileOption = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Apply a profile (tis net profiles; wifi_bad has delay only) to both directions; earlier changes end.",
        autocompletion=completion.profiles,
    ),
]


@app.command("set", example="tis net set both delay.delay_ms=80 --for-s 10")
def set_(
    *,
    direction: _DirectionArg = None,
    settings: _SettingsArg = None,
    yaml_text: _YamlOption = None,
    for_: _ForOption = None,
    ramp: _RampOption = None,
    at_s: _AtOption = None,
    profile: _ProfileOption = None,
    at: EmulatorOptions,
    as_json: JsonOption = False,
) -> int:
    """Change a running emulator's network: tis net set forward delay.delay_ms=50 loss.p_loss=0.05 --for-s 10.

    A permanent change replaces only what it names: earlier changes of other
    stages stay until `tis net reset`. Changes with --for-s add up: the later
    stage wins, factors (scale_...) multiply, additions sum. A profile must be
    without outages, states, timeline and rules.
    """
    from tis.deploy.net.control import seconds, set_change, set_profile

    address, given = at.emulator, bool(settings or yaml_text)
    if profile is not None:
        if direction or given or for_ or ramp or at_s is not None:
            raise InputError(
                Fault(
                    "tis net set",
                    "--profile",
                    "must be given alone: it applies to both directions, immediately and permanently",
                )
            )
        return set_profile(address, profile, OUT, as_json)
    if direction is None or not given:
        rule = "must read: tis net set forward|feedback|both a.b=VALUE ..., or --yaml TEXT, or --profile NAME"
        raise InputError(Fault("tis net set", "", rule))
    times = {} if at_s is None else {"at_s": at_s}
    times |= {} if for_ is None else {"for_s": seconds(for_, "--for-s")}
    times |= {} if ramp is None else {"ramp_s": seconds(ramp, "--ramp-s")}
    return set_change(address, direction, settings or (), yaml_text, times, OUT, as_json)


@app.command(example="tis net outage 0.5 --direction forward")
def outage(
    *,
    length: Annotated[
        str, typer.Argument(metavar="SECONDS", help="Duration, s, such as 0.5; or with its unit: 500ms.")
    ],
    direction: Annotated[str, typer.Option(help="forward (west to east), feedback (east to west) or both.")] = "both",
    stall: Annotated[
        bool, typer.Option("--stall", help="Messages wait for the end instead of being lost, as in a handover.")
    ] = False,
    at: EmulatorOptions,
    as_json: JsonOption = False,
) -> int:
    """Silence a running emulator for a while, starting now; messages offered meanwhile are lost.

    With --stall they wait, and leave together at the end.
    """
    from tis.deploy.net.control import check_direction, request, seconds

    check_direction(direction)
    content = {"direction": direction, "for_ms": seconds(length, "SECONDS") * 1000}
    content |= {"effect": "stall"} if stall else {}
    return request(at.emulator, "outage", content, OUT, as_json)


@app.command(example="tis net reset")
def reset(at: EmulatorOptions, as_json: JsonOption = False) -> int:
    """End all changes of a running emulator: the scenario's own network applies again."""
    from tis.deploy.net.control import request

    return request(at.emulator, "reset", {}, OUT, as_json)
