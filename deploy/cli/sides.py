"""Commands that run a single side: `surgeon`, `netem`, `patient`."""

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import typer

from tis.common.runtime.side_cli import side_command
from tis.deploy.cli.completion import profiles, scenarios
from tis.deploy.cli.group import Commands
from tis.deploy.shell.guard import ERR
from tis.netem.bridge.command import netem_command

if TYPE_CHECKING:  # what a run needs takes long to import: only when it runs, not for the help
    from tis.common.channels import Side
    from tis.common.runtime.side_cli import RunSide
    from tis.common.runtime.side_log import SideOptions
    from tis.common.runtime.status import Status
    from tis.common.scenario import Scenario
    from tis.common.scenario.network import NetworkPart

app = Commands("One side, on a host of its own")

DeviceKind = Literal["mouse", "gamepad"]


def _scenario_path(name: str) -> Path:
    from tis.deploy.run.resolve import scenario_path

    return scenario_path(name)


def _library(name: str) -> Mapping[str, Any]:
    from tis.deploy.net.profiles import library

    return library(name)


def _close_folder(run_dir: Path, network: "NetworkPart", exit_code: int, summarized: bool) -> int:
    """Complete the folder of a standalone netem; return the exit code."""
    from tis.deploy.standalone.command import close_folder

    return close_folder(run_dir, network, exit_code, summarized)


def _side_of(side: "Side", module: str) -> "RunSide":
    """Return the function that runs one side."""

    def run_side(scenario: "Scenario", options: "SideOptions", status: "Status") -> int:
        code: int = getattr(import_module(module), f"run_{side}")(scenario, options, status)
        return code

    return run_side


def _surgeon(scenario: "Scenario", options: "SideOptions", status: "Status") -> int:
    """Run the surgeon's side, with its device beside it."""
    from tis.deploy.device.command import device_beside

    with device_beside(scenario, options):
        return _side_of("surgeon", "tis.surgeon_side.__main__")(scenario, options, status)


app.register(
    side_command("surgeon", _surgeon, _scenario_path, _library, get_args(DeviceKind), scenarios),
    "surgeon",
    example="tis surgeon scenario.yaml --connect tcp/192.168.1.5:7447",
)
app.register(
    netem_command(
        _side_of("netem", "tis.netem.__main__"), _scenario_path, _library, _close_folder, scenarios, profiles
    ),
    "netem",
    example="tis netem --west tcp/127.0.0.1:7447 --east tcp/127.0.0.1:7448 'demo/**'",
)
app.register(
    side_command(
        "patient", _side_of("patient", "tis.patient_side.__main__"), _scenario_path, _library, (), scenarios
    ),
    "patient",
    example="tis patient scenario.yaml --connect tcp/192.168.1.5:7448",
)


@app.command(example="tis device mouse")
def device(
    kind: Annotated[DeviceKind, typer.Argument(help="mouse, in a window; or gamepad.")],
    connect: Annotated[
        list[str] | None,
        typer.Option(
            "--connect", "-e", metavar="ENDPOINT", help="netem's west endpoint [default: tcp/127.0.0.1:7447]"
        ),
    ] = None,
    key: Annotated[
        str, typer.Option(help="Key of the hand's device: source.keys of the scenario.")
    ] = "device/MTML/measured_cp",
    rate_hz: Annotated[int, typer.Option(min=1, max=1000, help="Poses per second.")] = 125,
    session: Annotated[str, typer.Option(help="The scenario's session, whose end ends the device.")] = "tis",
    wait_s: Annotated[float | None, typer.Option(min=0, help="Give up without netem after so many s.")] = None,
) -> int:
    """Be the device of a live source, with the mouse or a gamepad of this host."""
    from tis.deploy.device.command import run_device

    where = connect or ["tcp/127.0.0.1:7447"]
    return run_device(kind, where, key, rate_hz, session, lambda text: ERR.print(text, soft_wrap=True), wait_s)
