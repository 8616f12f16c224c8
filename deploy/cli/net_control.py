"""Commands that inspect and change a running emulator: ``tis net show|set|outage|reset``."""

from typing import Annotated

import typer

from tis.common.errors import Fault, InputError
from tis.common.runtime.side_cli import CfgOption, ConfigOption
from tis.deploy.cli.group import Commands, JsonOption
from tis.deploy.shell.guard import OUT, guarded

app = Commands()

EndpointOption = Annotated[
    str | None,
    typer.Option(
        "--connect",
        "-e",
        metavar="ENDPOINT",
        help="One of the emulator's networks, west or east; by default the endpoint of --config, "
        "else tcp/127.0.0.1:7447.",
    ),
]
PrefixOption = Annotated[str, typer.Option(help="Prefix of the emulator's control keys: the scenario's session.")]


@app.command()
@guarded
def show(
    connect: EndpointOption = None,
    prefix: PrefixOption = "tis",
    config: ConfigOption = None,
    cfg: CfgOption = None,
    as_json: JsonOption = False,
) -> int:
    """Show the current state of a running emulator in both directions."""
    from tis.common.runtime.emulator_client import emulator_address
    from tis.deploy.net.control import show as show_state

    return show_state(emulator_address(connect, prefix, config, cfg), OUT, as_json)


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
    str | None, typer.Option("--for", metavar="LENGTH", help="Duration, such as 10s; by default permanent.")
]
_RampOption = Annotated[
    str | None, typer.Option(metavar="LENGTH", help="Time in which factors and additions grow, such as 2s.")
]
_AtOption = Annotated[float | None, typer.Option("--at-s", help="Begin at this run time, s; by default immediately.")]
_ProfileOption = Annotated[
    str | None, typer.Option(metavar="NAME", help="Apply a profile to both directions; earlier changes end.")
]


@app.command("set")
@guarded
def set_(
    direction: _DirectionArg = None,
    settings: _SettingsArg = None,
    yaml_text: _YamlOption = None,
    for_: _ForOption = None,
    ramp: _RampOption = None,
    at_s: _AtOption = None,
    profile: _ProfileOption = None,
    connect: EndpointOption = None,
    prefix: PrefixOption = "tis",
    config: ConfigOption = None,
    cfg: CfgOption = None,
    as_json: JsonOption = False,
) -> int:
    """Change a running emulator's network: tis net set forward delay.delay_ms=50 loss.p_loss=0.05 --for 10s.

    A permanent change replaces the permanent one before. Changes with --for add
    up: the later stage wins, factors (scale_...) multiply, additions sum. A
    profile must be without outages, states, timeline and rules.
    """
    from tis.common.runtime.emulator_client import emulator_address
    from tis.deploy.net.control import seconds, set_change, set_profile

    address = emulator_address(connect, prefix, config, cfg)
    given = bool(settings or yaml_text)
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
    times |= {} if for_ is None else {"for_s": seconds(for_, "--for")}
    times |= {} if ramp is None else {"ramp_s": seconds(ramp, "--ramp")}
    return set_change(address, direction, settings or (), yaml_text, times, OUT, as_json)


@app.command()
@guarded
def outage(
    length: Annotated[str, typer.Argument(metavar="LENGTH", help="Duration, such as 500ms or 2s.")],
    direction: Annotated[str, typer.Option(help="forward (west to east), feedback (east to west) or both.")] = "both",
    stall: Annotated[
        bool, typer.Option("--stall", help="Messages wait for the end instead of being lost, as in a handover.")
    ] = False,
    connect: EndpointOption = None,
    prefix: PrefixOption = "tis",
    config: ConfigOption = None,
    cfg: CfgOption = None,
    as_json: JsonOption = False,
) -> int:
    """Silence a running emulator for a while, starting now; messages offered meanwhile are lost.

    With --stall they wait, and leave together at the end.
    """
    from tis.common.runtime.emulator_client import emulator_address
    from tis.deploy.net.control import check_direction, request, seconds

    check_direction(direction)
    content = {"direction": direction, "for_ms": seconds(length, "LENGTH") * 1000}
    content |= {"effect": "stall"} if stall else {}
    return request(emulator_address(connect, prefix, config, cfg), "outage", content, OUT, as_json)


@app.command()
@guarded
def reset(
    connect: EndpointOption = None,
    prefix: PrefixOption = "tis",
    config: ConfigOption = None,
    cfg: CfgOption = None,
    as_json: JsonOption = False,
) -> int:
    """End all changes of a running emulator: the scenario's own network applies again."""
    from tis.common.runtime.emulator_client import emulator_address
    from tis.deploy.net.control import request

    return request(emulator_address(connect, prefix, config, cfg), "reset", {}, OUT, as_json)
