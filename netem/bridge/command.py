"""The command ``tis netem``: a scenario's emulator, or one between any two Zenoh networks."""

import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, get_args

import typer

from tis.common.errors import EXIT_INTERRUPTED, Fault, InputError
from tis.common.runtime.process import guarded_exit_code, line_of
from tis.common.runtime.side_cli import (
    AloneOption,
    CfgOption,
    ChildOption,
    Completion,
    ConfigOption,
    ConnectOption,
    InsecureOption,
    WaitOption,
    side_command,
)
from tis.common.zenoh_syntax import endpoint_faults

if TYPE_CHECKING:  # what a run needs takes long to import: only when it runs, not for the help
    from tis.common.runtime.side_cli import RunSide
    from tis.common.scenario import reading
    from tis.common.scenario.network import NetworkPart
    from tis.netem.bridge.mirrors.queries import QueryTargetName
    from tis.netem.bridge.standalone import Carriage, Standalone

    CloseFolder = Callable[[Path, NetworkPart, int, bool], int]

Many = list[str] | None

_ALONE: Final = "Between any two networks"


def _alone(*names: str, **options: Any) -> Any:
    """Return an option of the emulator between any two networks."""
    return typer.Option(*names, rich_help_panel=_ALONE, **options)


RunDirOption = Annotated[
    Path | None,
    typer.Option(
        help="Folder for the log; when not given a new one below runs/, but between any two networks only with --log."
    ),
]
ListenOption = Annotated[
    Many, typer.Option("--listen", "-l", help="Zenoh endpoint to listen on, west, then east; overrides hosts.")
]
WestOption = Annotated[Many, _alone(help="Listen here for the one network.")]
EastOption = Annotated[Many, _alone(help="Listen here for the other network.")]
ConnectWestOption = Annotated[Many, _alone(help="Connect to the one network here.")]
ConnectEastOption = Annotated[Many, _alone(help="Connect to the other network here.")]
ModeOption = Annotated[str, _alone(help="How to connect: client or peer.")]
SetOption = Annotated[
    Many,
    _alone(
        "--set", metavar="a.b=VALUE",
        help="Set a value of the network (YAML), as `tis net stages` lists them, below forward (west to east) "
        "or feedback (east to west).",
    ),
]  # fmt: skip
UnmatchedOption = Annotated[str | None, _alone(help="Other keys: refuse (they do not cross) or pass.")]
SeedOption = Annotated[int, _alone(min=0, help="Decides every random number.")]
DurationOption = Annotated[float | None, _alone(min=0, help="End after so many s.")]
QueryOption = Annotated[float, _alone(min=0.1, help="Longest life of a query, in s.")]
TargetOption = Annotated[
    str,
    _alone(
        help="Queryables that a query from the other network reaches: best_matching, all or all_complete. Zenoh does "
        "not tell netem which of them the query asked for."
    ),
]
CarryOption = Annotated[
    str,
    _alone(
        metavar="messages|tcp|udp",
        help="messages: Zenoh's messages, by key; tcp: the bytes of TCP connections, unread, from --west to "
        "--connect-east, or from --east to --connect-west; udp: datagrams, unread, likewise.",
    ),
]
ControlOption = Annotated[
    str | None, _alone(metavar="ENDPOINT", help="With --carry tcp or udp: listen here for `tis net show|set|outage`.")
]
LogOption = Annotated[bool | None, _alone("--log/--no-log", help="Log every packet; as --run-dir says.")]
SummarizeOption = Annotated[
    bool, _alone("--summarize", help="Log, and at the end summarize the log, as `tis summarize` does.")
]
PrefixOption = Annotated[str, _alone(help="First chunk of the keys as tis/netem/control.")]


def _keys_arg(scenarios: Completion | None) -> Any:
    return typer.Argument(
        metavar="SCENARIO | KEYEXPR",
        help="A scenario (YAML), the same on every host; or, with --west and --east, the key expressions "
        "that cross and are impaired, all when none is given (ROS 2: '0/**', 0 being the domain).",
        autocompletion=scenarios,
    )


def _profile_option(names: Completion | None) -> Any:
    words = "Network of the library (tis net profiles), or a file; wifi_bad has delay only."
    return _alone(help=words, autocompletion=names)


def _network_option(scenarios: Completion | None) -> Any:
    return _alone(
        "--scenario-network",
        metavar="FILE|SCENARIO",
        help="File (YAML) with a network, or a scenario with one; not beside --profile.",
        autocompletion=scenarios,
    )


def netem_command(
    run_side: "RunSide",
    locate: Callable[[str], Path] = Path,
    profiles: "reading.Profiles | None" = None,
    close_folder: "CloseFolder | None" = None,
    scenarios: Completion | None = None,
    profile_names: Completion | None = None,
) -> Callable[..., None]:
    """Return the typer command. ``locate`` finds a scenario's file, ``profiles`` is the library of networks.

    ``close_folder`` completes the folder of a log that was written between any two networks, by its exit code, and
    summarizes it if asked to; it returns the exit code;
    ``scenarios`` and ``profile_names`` complete names.
    """
    run_scenario = side_command("netem", run_side, locate, profiles)

    # One parameter per option: typer reads the command line off this signature.
    def command(
        words: Annotated[Many, _keys_arg(scenarios)] = None,
        run_dir: RunDirOption = None,
        connect: ConnectOption = None,
        listen: ListenOption = None,
        config: ConfigOption = None,
        cfg: CfgOption = None,
        wait_s: WaitOption = None,
        west: WestOption = None,
        east: EastOption = None,
        connect_west: ConnectWestOption = None,
        connect_east: ConnectEastOption = None,
        mode: ModeOption = "client",
        profile: Annotated[str | None, _profile_option(profile_names)] = None,
        network: Annotated[str | None, _network_option(scenarios)] = None,
        settings: SetOption = None,
        unmatched: UnmatchedOption = None,
        seed: SeedOption = 0,
        duration_s: DurationOption = None,
        query_time_out_s: QueryOption = 600.0,
        query_target: TargetOption = "best_matching",
        log: LogOption = None,
        summarize: SummarizeOption = False,
        carry: CarryOption = "messages",
        control: ControlOption = None,
        prefix: PrefixOption = "tis",
        insecure: InsecureOption = False,
        child: ChildOption = False,
        alone: AloneOption = False,
    ) -> None:
        """Run the emulator: of a scenario, for a host of its own, or between any two Zenoh networks."""
        keys = words or []
        places = {"--west": west, "--east": east, "--connect-west": connect_west, "--connect-east": connect_east}

        def run() -> int:
            from tis.common.runtime.zenoh_session import ZenohOptions
            from tis.netem.bridge.chosen_network import read_network
            from tis.netem.bridge.sides import Place
            from tis.netem.bridge.standalone import Standalone

            _check(connect or listen, places, mode)
            file = None if network is None else locate(network)
            where, part = read_network(file, profile, settings or [], unmatched, profiles)
            asked = Standalone(
                places={"west": Place(tuple(west or ()), tuple(connect_west or ())),
                        "east": Place(tuple(east or ()), tuple(connect_east or ()))},
                network=part, keys=keys or ("**",), where=where, seed=seed,
                zenoh=ZenohOptions(connect or (), listen or (), config, cfg or (), insecure),
                mode="peer" if mode == "peer" else "client", duration_s=duration_s, wait_s=wait_s,
                log_dir=_log_folder(run_dir, True if summarize else log), summarize=summarize,
                query_time_out_s=query_time_out_s, query_target=_query_target(query_target),
                prefix=prefix, carry=_carriage(carry, control), control=control,
            )  # fmt: skip
            return _run(asked, keys, locate, profiles, close_folder)

        def refuse() -> int:
            from tis.netem.bridge.chosen_network import read_network

            file = None if network is None else locate(network)
            read_network(file, profile, [], None, profiles)  # its faults come first
            rule = "must be one scenario; for key expressions give the two networks, --west and --east"
            raise InputError(Fault("netem", "SCENARIO", rule, *([keys] if keys else [])))

        if any(places.values()):
            raise typer.Exit(guarded_exit_code("netem", run, _print_faults))
        if len(keys) != 1 or "*" in keys[0]:
            raise typer.Exit(guarded_exit_code("netem", refuse, _print_faults))
        run_scenario(keys[0], run_dir, connect, listen, config, cfg, wait_s, insecure, child, alone)

    return command


def _check(of_scenario: Many, places: Mapping[str, Many], mode: str) -> None:
    """Raise `InputError` for endpoints ``of_scenario``, which no network has here, and for what cannot be used."""
    if of_scenario:
        rule = "must not stand beside --west, --east, --connect-west and --connect-east"
        raise InputError(Fault("netem", "--connect, --listen", rule))
    _refuse(endpoint_faults("netem", {option: given or () for option, given in places.items()}))
    if mode not in ("client", "peer"):
        raise InputError(Fault("netem", "--mode", "must be client or peer", mode))


def _refuse(found: Sequence[Fault]) -> None:
    if found:
        raise InputError(found)


def _log_folder(run_dir: Path | None, log: bool | None) -> Path | None:
    """Return the folder of the log, None without one: between any two networks it has to be asked for."""
    from tis.common.runtime.run_folders import RUNS, run_folder

    folder = run_folder(RUNS, "netem") if run_dir is None else run_dir
    return folder if (run_dir is not None if log is None else log) else None


def _carriage(name: str, control: str | None) -> "Carriage":
    from tis.netem.bridge.standalone import Carriage

    found = next((one for one in get_args(Carriage) if one == name), None)
    if found is None:
        raise InputError(Fault("netem", "--carry", f"must be {', '.join(get_args(Carriage))}", name))
    if found == "messages" and control is not None:
        raise InputError(Fault("netem", "--control", "needs --carry tcp or udp: else both networks answer", control))
    _refuse(endpoint_faults("netem", {"--control": [] if control is None else [control]}))
    carriage: Carriage = found
    return carriage


def _query_target(name: str) -> "QueryTargetName":
    from tis.netem.bridge.mirrors.queries import TARGETS

    for target in TARGETS:
        if target == name:
            return target
    raise InputError(Fault("netem", "--query-target", f"must be {', '.join(TARGETS)}", name))


def _run(
    asked: "Standalone",
    words: Sequence[str],
    locate: Callable[[str], Path],
    profiles: "reading.Profiles | None",
    close_folder: "CloseFolder | None",
) -> int:
    """Run the emulator between two networks to its end and complete its folder; return the exit code."""
    from tis.common.runtime.scenario_files import lines_told
    from tis.common.runtime.status import Status
    from tis.netem.bridge.standalone import run_standalone

    if asked.carry != "messages":
        from tis.netem.bridge.carrying import run_carrying as run_standalone

    status = Status("netem", as_events=False)
    for word in words:
        if _is_file(word, locate):
            status.warning(f"{word} is taken for a key; --scenario-network {word} makes it the network")
    with nullcontext() if asked.where == "netem" else lines_told(Path(asked.where)):
        code = run_standalone(asked, status, profiles)
    has_begun = code != EXIT_INTERRUPTED  # otherwise it still waited for a network, and there is no log
    if asked.log_dir is not None and close_folder is not None and has_begun:
        return close_folder(asked.log_dir, asked.network, code, asked.summarize)
    return code


def _is_file(word: str, locate: Callable[[str], Path]) -> bool:
    try:
        return locate(word).is_file()
    except (InputError, OSError, ValueError):
        return False


def _print_faults(_: int, found: Sequence[Fault]) -> None:
    for fault in found:
        print(line_of("netem", fault), file=sys.stderr, flush=True)  # noqa: T201
