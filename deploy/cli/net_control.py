"""``tis net show|set|outage|reset``: a running emulator, asked and changed from the shell."""

from typing import Annotated

import typer

from common.errors import Fault, InputError
from common.runtime.zenoh_cli import CfgOption, ConfigOption
from deploy.shell.guard import OUT, guarded

app = typer.Typer()

EndpointOption = Annotated[
    str | None,
    typer.Option(
        "--connect",
        "-e",
        metavar="ENDPOINT",
        help="A network of the emulator's, west or east; --config's endpoint, else tcp/127.0.0.1:7447, "
        "when not given.",
    ),
]
PrefixOption = Annotated[str, typer.Option(help="What the emulator goes by: the scenario's session.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON.")]


@app.command()
@guarded
def show(
    connect: EndpointOption = None,
    prefix: PrefixOption = "tis",
    config: ConfigOption = None,
    cfg: CfgOption = None,
    as_json: JsonOption = False,
) -> int:
    """Show what a running emulator does now, in both directions."""
    from deploy.net.control.control_commands import show as show_state
    from deploy.net.control.remote import place_of

    return show_state(place_of(connect, prefix, config, cfg), OUT, as_json)


@app.command("set")
@guarded
def set_(
    direction: Annotated[
        str | None,
        typer.Argument(
            metavar="[forward|feedback|both]", help="forward: west to east; feedback: back. Not beside --profile."
        ),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Argument(metavar="[a.b=VALUE]...", help="Like delay.delay_ms=50: `tis net stages` lists them."),
    ] = None,
    yaml_text: Annotated[
        str | None, typer.Option("--yaml", metavar="TEXT", help="Stages in YAML; a.b=VALUE overrides them.")
    ] = None,
    for_: Annotated[
        str | None,
        typer.Option(
            "--for",
            metavar="LENGTH",
            help="How long, like 10s; for good when not given, in place of what was set for good.",
        ),
    ] = None,
    ramp: Annotated[
        str | None, typer.Option(metavar="LENGTH", help="How long factors and additions take to grow, like 2s.")
    ] = None,
    at_s: Annotated[
        float | None, typer.Option("--at-s", help="When, in s of run time; at once when not given.")
    ] = None,
    profile: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Both ways become those of a profile (tis net profiles) without outages, states, timeline, rules; "
            "what was set before ends.",
        ),
    ] = None,
    connect: EndpointOption = None,
    prefix: PrefixOption = "tis",
    config: ConfigOption = None,
    cfg: CfgOption = None,
    as_json: JsonOption = False,
) -> int:
    """Change a running emulator's network: tis net set forward delay.delay_ms=50 loss.p_loss=0.05 --for 10s.

    Changes with --for come on top of each other: the later stage wins, factors (scale_delay) multiply, additions add.
    """
    from deploy.net.control.change import seconds
    from deploy.net.control.control_commands import set_change, set_profile
    from deploy.net.control.remote import place_of

    place = place_of(connect, prefix, config, cfg)
    given = bool(settings or yaml_text)
    if profile is not None:
        if direction or given or for_ or ramp or at_s is not None:
            raise InputError(
                Fault("tis net set", "--profile", "must stand alone: it is both ways, at once, for good")
            )
        return set_profile(place, profile, OUT, as_json)
    if direction is None or not given:
        rule = "must read: tis net set forward|feedback|both a.b=VALUE ..., or --yaml TEXT, or --profile NAME"
        raise InputError(Fault("tis net set", "", rule))
    times = {} if at_s is None else {"at_s": at_s}
    times |= {} if for_ is None else {"for_s": seconds(for_, "--for")}
    times |= {} if ramp is None else {"ramp_s": seconds(ramp, "--ramp")}
    return set_change(place, direction, settings or (), yaml_text, times, OUT, as_json)


@app.command()
@guarded
def outage(
    length: Annotated[str, typer.Argument(metavar="LENGTH", help="How long, like 500ms or 2s.")],
    direction: Annotated[str, typer.Option(help="forward (west to east), feedback (east to west) or both.")] = "both",
    connect: EndpointOption = None,
    prefix: PrefixOption = "tis",
    config: ConfigOption = None,
    cfg: CfgOption = None,
    as_json: JsonOption = False,
) -> int:
    """Silence a running emulator for a while, from now on: what is offered meanwhile is lost."""
    from deploy.net.control.change import seconds
    from deploy.net.control.control_commands import check_direction, request
    from deploy.net.control.remote import place_of

    check_direction(direction)
    content = {"direction": direction, "for_ms": seconds(length, "LENGTH") * 1000}
    return request(place_of(connect, prefix, config, cfg), "outage", content, OUT, as_json)


@app.command()
@guarded
def reset(
    connect: EndpointOption = None,
    prefix: PrefixOption = "tis",
    config: ConfigOption = None,
    cfg: CfgOption = None,
    as_json: JsonOption = False,
) -> int:
    """End everything that was asked of a running emulator: it is the scenario's again."""
    from deploy.net.control.control_commands import request
    from deploy.net.control.remote import place_of

    return request(place_of(connect, prefix, config, cfg), "reset", {}, OUT, as_json)
