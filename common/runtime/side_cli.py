"""The command line of one side, the same for `python -m surgeon_side` and `tis surgeon`."""

import ctypes
import os
import signal
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from common.channels import Side
from common.errors import Fault, InputError
from common.runtime.clock import monotonic_ns
from common.runtime.guard import guarded_exit_code
from common.runtime.recordings import located
from common.runtime.side import SideOptions
from common.runtime.status import Status
from common.runtime.zenoh_cli import CfgOption, ConfigOption
from common.runtime.zenoh_session import ZenohOptions
from common.scenario import Scenario
from common.scenario import reading as scenario_io

_PR_SET_PDEATHSIG: Final = 1

RunSide = Callable[[Scenario, SideOptions, Status], int]


def read_scenario(path: Path) -> dict[str, Any]:
    """Return a scenario file's top-level mapping, not validated yet; raises `InputError`."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise InputError(Fault(str(path), "", f"cannot be read: {reason}")) from None
    return scenario_io.parse_yaml(text, str(path))


def run_folder(base: Path, name: str) -> Path:
    """Return a new folder's name below ``base``: the date, the time and the scenario."""
    stamp = time.strftime("%Y%m%d_%H%M%S")
    path, n = base / f"{stamp}_{name}", 1
    while path.exists():
        n += 1
        path = base / f"{stamp}_{name}_{n}"
    return path


def side_command(
    side: Side,
    run_side: RunSide,
    locate: Callable[[str], Path] = Path,
    profiles: scenario_io.Profiles | None = None,
) -> Callable[..., None]:
    """Return the typer command that runs one side alone.

    ``locate`` finds the file that a scenario's name means, ``profiles`` is the library that its network may name.
    """

    def command(
        scenario: Annotated[
            str, typer.Argument(metavar="SCENARIO", help="Scenario file (YAML); the same one on every host.")
        ],
        run_dir: Annotated[
            Path | None, typer.Option(help="Folder for the log; a new one below runs/ when not given.")
        ] = None,
        connect: Annotated[
            list[str] | None,
            typer.Option("--connect", "-e", help="Zenoh endpoint to connect to; overrides hosts."),
        ] = None,
        listen: Annotated[
            list[str] | None,
            typer.Option("--listen", "-l", help="Zenoh endpoint to listen on; overrides hosts."),
        ] = None,
        config: ConfigOption = None,
        cfg: CfgOption = None,
        wait_s: Annotated[
            float | None, typer.Option(min=0, help="Give up when the others are not there after so many s.")
        ] = None,
        child: Annotated[bool, typer.Option(hidden=True, help="Started by `tis run`: speak in events.")] = False,
    ) -> None:
        status = Status(side, as_events=child)
        if child:
            _die_with_parent()

        def run() -> int:
            monotonic_ns()  # a skew that cannot be read is refused here
            file = locate(scenario)
            agreed = located(scenario_io.build_scenario(read_scenario(file), str(file), profiles))
            zenoh_options = ZenohOptions(connect or (), listen or (), config, cfg or ())
            where = run_folder(Path("runs"), agreed.name) if run_dir is None else run_dir
            return run_side(agreed, SideOptions(where, zenoh_options, wait_s, alone=not child), status)

        def failed(code: int, faults: Sequence[Fault]) -> None:
            status.failed(code, [str(fault) for fault in faults])

        raise typer.Exit(guarded_exit_code(side, run, failed))

    command.__doc__ = f"Run the {side} side alone, for a host of its own; start the sides in any order."
    return command


def endpoints_for(scenario: Scenario, side: Side, place: str) -> tuple[str, ...]:
    """Return the endpoint that ``hosts`` gives for ``place`` (west or east); raises `InputError` when it is auto."""
    if scenario.hosts == "auto":
        flag = "--listen" if side == "netem" else "--connect"
        raise InputError(Fault(side, "hosts", f"auto works in `tis run` only: give hosts or {flag}"))
    return (getattr(scenario.hosts, place),)


def _die_with_parent() -> None:
    """End this process when `tis run` is killed (Linux; elsewhere without effect)."""
    prctl = getattr(ctypes.CDLL(None), "prctl", None)
    if prctl is not None:
        prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
        if os.getppid() == 1:
            sys.exit(0)
