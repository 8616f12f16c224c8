"""The command ``tis netem``: a scenario's emulator, or one between any two Zenoh networks."""

import sys
import traceback
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import ValidationError

from common.endpoint import endpoint_faults
from common.errors import EXIT_BUG, EXIT_INTERRUPTED, DataError, Fault, InputError, TisError
from common.runtime.side_cli import RunSide, read_scenario, run_folder, side_command
from common.runtime.status import Status
from common.runtime.zenoh_cli import CfgOption, ConfigOption
from common.runtime.zenoh_session import ZenohOptions
from common.scenario import reading as scenario_io
from common.scenario.faults import faults
from common.scenario.network import NetworkPart
from common.scenario.overrides import Override, apply_overrides, blamed

_ALONE = "Between any two networks"

Many = list[str] | None


def netem_command(
    run_side: RunSide,
    locate: Callable[[str], Path] = Path,
    profiles: scenario_io.Profiles | None = None,
    close_folder: Callable[[Path, NetworkPart, int], None] | None = None,
) -> Callable[..., None]:
    """Return the typer command. ``locate`` finds a scenario's file, ``profiles`` is the library of networks.

    ``close_folder`` completes the folder of a log that was written between any two networks, by its exit code.
    """
    run_scenario = side_command("netem", run_side, locate, profiles)

    def command(
        words: Annotated[
            Many,
            typer.Argument(
                metavar="SCENARIO | KEYEXPR",
                help="A scenario (YAML), the same on every host; or, with --west and --east, the key expressions "
                "that cross and are impaired, all when none is given (ROS 2: '0/**', 0 being the domain).",
            ),
        ] = None,
        run_dir: Annotated[
            Path | None,
            typer.Option(
                help="Folder for the log; when not given a new one below runs/, but between any two networks only "
                "with --log."
            ),
        ] = None,
        connect: Annotated[
            Many, typer.Option("--connect", "-e", help="Zenoh endpoint to connect to; overrides hosts.")
        ] = None,
        listen: Annotated[
            Many,
            typer.Option("--listen", "-l", help="Zenoh endpoint to listen on, west, then east; overrides hosts."),
        ] = None,
        config: ConfigOption = None,
        cfg: CfgOption = None,
        wait_s: Annotated[
            float | None, typer.Option(min=0, help="Give up when the others are not there after so many s.")
        ] = None,
        west: Annotated[
            Many, typer.Option(help="Listen here for the one network.", rich_help_panel=_ALONE)
        ] = None,
        east: Annotated[
            Many, typer.Option(help="Listen here for the other network.", rich_help_panel=_ALONE)
        ] = None,
        connect_west: Annotated[
            Many, typer.Option(help="Connect to the one network here.", rich_help_panel=_ALONE)
        ] = None,
        connect_east: Annotated[
            Many, typer.Option(help="Connect to the other network here.", rich_help_panel=_ALONE)
        ] = None,
        mode: Annotated[
            str, typer.Option(help="How to connect: client or peer.", rich_help_panel=_ALONE)
        ] = "client",
        profile: Annotated[
            str | None,
            typer.Option(help="Network of the library (tis net profiles), or a file.", rich_help_panel=_ALONE),
        ] = None,
        network: Annotated[
            str | None,
            typer.Option(
                "--scenario-network", metavar="FILE|SCENARIO", help="File (YAML) with a network, or a scenario with "
                "one; not beside --profile.", rich_help_panel=_ALONE,
            ),
        ] = None,
        settings: Annotated[
            Many,
            typer.Option(
                "--set", metavar="a.b=VALUE", rich_help_panel=_ALONE, help="Set a value of the network (YAML), as "
                "`tis net stages` lists them, below forward (west to east) or feedback (east to west).",
            ),
        ] = None,
        unmatched: Annotated[
            str | None,
            typer.Option(help="Other keys: refuse (they do not cross) or pass.", rich_help_panel=_ALONE),
        ] = None,
        seed: Annotated[
            int, typer.Option(min=0, help="Decides every random number.", rich_help_panel=_ALONE)
        ] = 0,
        duration_s: Annotated[
            float | None, typer.Option(min=0, help="End after so many s.", rich_help_panel=_ALONE)
        ] = None,
        query_time_out_s: Annotated[
            float, typer.Option(min=0.1, help="Longest life of a query, in s.", rich_help_panel=_ALONE)
        ] = 600.0,
        log: Annotated[
            bool | None,
            typer.Option("--log/--no-log", help="Log every packet; as --run-dir says.", rich_help_panel=_ALONE),
        ] = None,
        prefix: Annotated[
            str, typer.Option(help="First chunk of the keys as tis/netem/control.", rich_help_panel=_ALONE)
        ] = "tis",
        child: Annotated[bool, typer.Option(hidden=True, help="Started by `tis run`: speak in events.")] = False,
    ) -> None:  # fmt: skip
        """Run the emulator: of a scenario, for a host of its own, or between any two Zenoh networks."""
        words = words or []
        alone = {"--west": west, "--east": east, "--connect-west": connect_west, "--connect-east": connect_east}
        if not any(alone.values()):
            if len(words) != 1:
                _end(Fault("netem", "SCENARIO", "must be one scenario, unless --west and --east are given", words))
            run_scenario(words[0], run_dir, connect, listen, config, cfg, wait_s, child)
            return

        def run() -> int:
            from netem.bridge.sides import Place
            from netem.bridge.standalone import Standalone, run_standalone

            if connect or listen:
                flags = "--west, --east, --connect-west and --connect-east"
                raise InputError(Fault("netem", "--connect, --listen", f"must not stand beside {flags}"))
            faults = endpoint_faults("netem", {option: given or () for option, given in alone.items()})
            if faults:
                raise InputError(faults)
            if mode not in ("client", "peer"):
                raise InputError(Fault("netem", "--mode", "must be client or peer", mode))
            file = None if network is None else locate(network)
            where, part = read_network(file, profile, settings or [], unmatched, profiles)
            logs = run_dir is not None if log is None else log
            folder = run_folder(Path("runs"), "netem") if run_dir is None else run_dir
            asked = Standalone(
                places={
                    "west": Place(tuple(west or ()), tuple(connect_west or ())),
                    "east": Place(tuple(east or ()), tuple(connect_east or ())),
                },
                network=part,
                keys=words or ("**",),
                where=where,
                seed=seed,
                zenoh=ZenohOptions(config=config, cfg=cfg or ()),
                mode="peer" if mode == "peer" else "client",
                duration_s=duration_s,
                log_dir=folder if logs else None,
                wait_s=wait_s,
                query_time_out_s=query_time_out_s,
                prefix=prefix,
            )
            status = Status("netem", as_events=False)
            for word in words:
                if _is_file(word, locate):
                    status.warning(f"{word} is taken for a key; --scenario-network {word} makes it the network")
            code = run_standalone(asked, status, profiles)
            has_begun = code != EXIT_INTERRUPTED  # else it still waited for a network
            if asked.log_dir is not None and close_folder is not None and has_begun:
                close_folder(asked.log_dir, part, code)
            return code

        raise typer.Exit(_guarded(run))

    return command


def read_network(
    file: Path | None,
    profile: str | None,
    settings: list[str],
    unmatched: str | None,
    profiles: scenario_io.Profiles | None,
) -> tuple[str, NetworkPart]:
    """Return where a network comes from and the network itself; raises `InputError` with every fault.

    A file may hold a network, or a scenario of which only the network counts. ``settings`` (``a.b=VALUE``, with
    ``network.`` before it or not) come after the values of the profile or the file.
    """
    bare = [setting.removeprefix("network.") for setting in settings]
    chosen = [setting for setting in bare if setting.partition("=")[0] == "profile"]
    name = scenario_io.apply_settings({"profile": profile}, chosen).get("profile")
    if file is not None and name is not None:
        rule = "must not stand beside --scenario-network: name it in the file, as `profile`"
        raise InputError(Fault("netem", "--profile", rule, name))
    raw: Mapping[str, Any] = {} if file is None else read_scenario(file)
    where = "netem" if file is None else str(file)
    part = raw.get("network", {}) if "network" in raw or "version" in raw else raw
    if name is not None:
        part = {"profile": name}
    if profiles is not None:
        part = _expanded(part, where, "--profile" if file is None else "profile", profiles)
    overrides = [Override("--set", setting) for setting in bare if setting not in chosen]
    overrides += [] if unmatched is None else [Override("--unmatched", f"unmatched={unmatched}")]
    changed, found = apply_overrides(part, overrides, []) if isinstance(part, Mapping) else (part, [])
    network, invalid = _validated(changed, where)
    if network is not None and not found:
        return where, network
    raise InputError(blamed([*found, *invalid], where, _validated(part, where)[1], overrides))


def _validated(part: Any, where: str) -> tuple[NetworkPart | None, list[Fault]]:
    """Return a network, None when it is not valid, and all that is wrong."""
    try:
        return NetworkPart.model_validate(part), []
    except ValidationError as error:
        return None, faults(error, NetworkPart, where)


def _expanded(part: Any, where: str, field: str, profiles: scenario_io.Profiles) -> Any:
    """Return a network with its profile's values; a name that is none is blamed on ``field``."""
    try:
        return scenario_io.expand_profile({"network": part}, where, profiles)["network"]
    except InputError as error:
        found = [replace(one, field=field) if one.field == "network.profile" else one for one in error.faults]
    raise InputError(found)


def _is_file(word: str, locate: Callable[[str], Path]) -> bool:
    try:
        return locate(word).is_file()
    except (InputError, OSError, ValueError):
        return False


def _guarded(run: Callable[[], int]) -> int:
    """Turn errors into a line each and an exit code; a bug keeps its traceback."""
    try:
        code = run()
    except TisError as error:
        for fault in error.faults:
            _complain(fault)
        code = error.exit_code
    except OSError as error:
        _complain(Fault("netem", str(error.filename or ""), error.strerror or str(error)))
        code = DataError.exit_code
    except Exception as error:
        traceback.print_exc()
        _complain(Fault("netem", "", f"bug: {type(error).__name__}: {error}"))
        code = EXIT_BUG
    sys.stdout.flush()
    return code


def _complain(fault: Fault) -> None:
    print(f"netem: {fault}" if fault.where != "netem" else str(fault), file=sys.stderr, flush=True)  # noqa: T201


def _end(fault: Fault) -> None:
    _complain(fault)
    raise typer.Exit(InputError.exit_code)
