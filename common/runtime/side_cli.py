"""The command line of one side, the same for `python -m tis.surgeon_side` and `tis surgeon`, and options for Zenoh.

Zenoh's options, ``-c FILE --cfg KEY:VALUE --insecure``, are common to all commands that connect.
"""

from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tis.common.errors import Fault, InputError
from tis.common.runtime.process import guarded_exit_code

if TYPE_CHECKING:  # what a run needs takes long to import: only when it runs, not for the help
    from tis.common.channels import Side
    from tis.common.runtime.side_log import SideOptions
    from tis.common.runtime.status import Status
    from tis.common.scenario import Scenario, reading

    RunSide = Callable[[Scenario, SideOptions, Status], int]

ConfigOption = Annotated[Path | None, typer.Option("--config", "-c", help="Zenoh configuration file (JSON5).")]
CfgOption = Annotated[
    list[str] | None, typer.Option("--cfg", help="Zenoh setting KEY:VALUE, VALUE in JSON5; overrides --config.")
]


def insecure_option(listens: bool = True) -> Any:
    """Return the option that lets everybody connect; hidden where nothing listens."""
    return typer.Option(
        "--insecure",
        hidden=not listens,
        help="Listen beyond loopback although anybody may connect: no certificates, no users.",
    )


InsecureOption = Annotated[bool, insecure_option()]

ConnectOption = Annotated[
    list[str] | None, typer.Option("--connect", "-e", help="Zenoh endpoint to connect to; overrides hosts.")
]
ListenOption = Annotated[
    list[str] | None, typer.Option("--listen", "-l", help="Zenoh endpoint to listen on; overrides hosts.")
]
LogFolderOption = Annotated[
    Path | None,
    typer.Option(help="Folder for the log; by default a new one below runs/, after a kill that of the same run."),
]
WaitOption = Annotated[
    float | None, typer.Option(min=0, help="Give up when the others are not there after so many s.")
]
ChildOption = Annotated[bool, typer.Option(hidden=True, help="Started by `tis run`: speak in events.")]
AloneOption = Annotated[bool, typer.Option(hidden=True, help="With --child: on a host of its own, by `tis up`.")]

Completion = Callable[[str], list[str]]
"""What a shell may put in place of an incomplete word."""


def side_command(
    side: "Side",
    run_side: "RunSide",
    locate: Callable[[str], Path] = Path,
    profiles: "reading.Profiles | None" = None,
    devices: Collection[str] = (),
    scenarios: Completion | None = None,
) -> Callable[..., None]:
    """Return the typer command that runs one side alone.

    ``locate`` finds the file that a scenario's name means, ``profiles`` is the library that its network may name,
    ``devices`` are the kinds of devices that ``run_side`` can start beside it, ``scenarios`` completes a name.
    """

    def command(
        scenario: Annotated[str, _scenario_arg(scenarios)],
        run_dir: LogFolderOption = None,
        connect: ConnectOption = None,
        listen: ListenOption = None,
        config: ConfigOption = None,
        cfg: CfgOption = None,
        wait_s: WaitOption = None,
        insecure: Annotated[bool, insecure_option(side == "netem")] = False,
        child: ChildOption = False,
        alone: AloneOption = False,
        witness: Annotated[bool, _witness_option(side)] = False,
        device: Annotated[str | None, _device_option(devices)] = None,
    ) -> None:
        from tis.common.runtime.status import Status

        status = Status(side, as_events=child)

        def run() -> int:
            from tis.common.runtime.clock import monotonic_ns
            from tis.common.runtime.recordings import build_whole, located
            from tis.common.runtime.scenario_files import lines_told, read_scenario
            from tis.common.runtime.side_log import SideOptions
            from tis.common.runtime.zenoh_session import ZenohOptions

            monotonic_ns()  # a skew that cannot be read is refused here
            file = locate(scenario)
            with lines_told(file):
                agreed = located(build_whole(read_scenario(file), str(file), profiles))
            zenoh_options = ZenohOptions(connect or (), listen or (), config, cfg or (), insecure)
            _check_company(side, witness, device, devices)
            options = SideOptions(run_dir, zenoh_options, wait_s, alone or not child, witness, device)
            return run_side(agreed, options, status)

        def failed(code: int, faults: Sequence[Fault]) -> None:
            status.failed(code, [str(fault) for fault in faults])

        raise typer.Exit(guarded_exit_code(side, run, failed))

    command.__doc__ = f"Run the {side} side alone, for a host of its own; start the sides in any order."
    return command


def _scenario_arg(names: Completion | None) -> Any:
    words = "Scenario file (YAML); the same one on every host."
    return typer.Argument(metavar="SCENARIO", help=words, autocompletion=names)


def _witness_option(side: "Side") -> Any:
    """Return the option by which the surgeon's process only writes a log."""
    words = "Another program is the surgeon: only write its log."
    return typer.Option("--witness", hidden=side != "surgeon", help=words)


def _device_option(devices: Collection[str]) -> Any:
    """Return the option that starts one of the ``devices`` beside a side; hidden without any."""
    return typer.Option(hidden=not devices, metavar="|".join(devices) or None, help="Start this device beside it.")


def _check_company(side: "Side", witness: bool, device: str | None, devices: Collection[str]) -> None:
    """Raise `InputError` for a witness or a device that a side cannot have."""
    faults = []
    if witness and side != "surgeon":
        faults.append(Fault(side, "--witness", "works for the surgeon only"))
    if device is not None and device not in devices:
        rule = f"must be {' or '.join(devices)}" if devices else "works in `tis surgeon` only"
        faults.append(Fault(side, "--device", rule, device))
    if faults:
        raise InputError(faults)


def endpoints_for(scenario: "Scenario", side: "Side", place: str) -> tuple[str, ...]:
    """Return the endpoint that ``hosts`` gives for ``place`` (west or east); raises `InputError` when it is auto."""
    if scenario.hosts == "auto":
        flag = "--listen" if side == "netem" else "--connect"
        raise InputError(Fault(side, "hosts", f"auto works in `tis run` only: give hosts or {flag}"))
    return (getattr(scenario.hosts, place),)
